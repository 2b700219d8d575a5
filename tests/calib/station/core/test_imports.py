"""The station's core decides, and touches nothing: nothing of it loads what opens a socket, a file or a session."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from calib.station.core import playback

CORE = sorted(Path(playback.__file__).parent.glob("*.py"))
# cv2 is loaded by the mathematics, for its linear algebra (calib/tracking/filterbank.py).
NEVER_LOADED = ("zenoh", "serial", "mcap", "pymavlink", "onnxruntime", "matplotlib", "nicegui")
NEVER_IMPORTED = {
    "asyncio", "io", "logging", "multiprocessing", "os", "pathlib", "shutil", "socket", "subprocess", "tempfile",
    "threading", "time", "tomllib",
}  # fmt: skip


def test_loading_the_core_loads_nothing_that_touches_the_world() -> None:
    assert len(CORE) > 10
    names = ", ".join(f"calib.station.core.{path.stem}" for path in CORE if path.stem != "__init__")
    code = f"import sys, {names}; print('\\n'.join(sys.modules))"
    listed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert not {name.partition(".")[0] for name in listed.stdout.split()} & set(NEVER_LOADED)


@pytest.mark.parametrize("path", CORE, ids=lambda path: path.stem)
def test_a_module_of_the_core_opens_nothing_and_asks_no_clock(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not {name.partition(".")[0] for name in imported} & NEVER_IMPORTED
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id == "open"]
