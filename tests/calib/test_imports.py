"""The mathematics imports nothing that touches the world."""

import ast
import subprocess
import sys
from pathlib import Path

import calib

FORBIDDEN = ("zenoh", "serial", "pymavlink", "onnxruntime", "mcap")
HOUSE = Path(calib.__path__[0]).parent
PURE = sorted(path for path in (HOUSE / "calib").rglob("*.py") if "station" not in path.relative_to(HOUSE).parts)
ALLOWED_OF_EDGE = ("edge.common", "edge.lens", "edge.messages")


def test_calib_outside_the_station_imports_only_the_lens_of_edge() -> None:
    assert len(PURE) > 40
    names = [path.relative_to(HOUSE).with_suffix("").as_posix().replace("/", ".") for path in PURE]
    code = f"import sys, {', '.join(names)}; print('\\n'.join(sorted(sys.modules)))"
    listed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    loaded = set(listed.stdout.split())
    assert not {name for name in FORBIDDEN if name in loaded}
    assert not [name for name in loaded if name.startswith("edge.") and not name.startswith(ALLOWED_OF_EDGE)]
    assert not {name for name in loaded if name.startswith("calib.station")}


def test_calib_outside_the_station_touches_no_file_socket_thread_or_clock() -> None:
    world = {"asyncio", "io", "multiprocessing", "os", "pathlib", "socket", "subprocess", "threading", "time"}
    for path in PURE:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
        imported |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not {name.split(".")[0] for name in imported} & world, path.name
        opened = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id == "open"]
        assert not opened, path.name
