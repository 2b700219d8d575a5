"""What a user gets: the wheel, built and installed into an empty environment, does what README and guide say.

Far from the checkout, so that nothing is found there by chance. The environment shares the libraries of this one (there
may be no network here), but not this one's own Skyfix: a path in a .pth file is searched, its .pth files are not read.
"""

import os
import re
import subprocess
import sys
import sysconfig
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pytest

from tests.places import ROOT
from tests.tools.guidebook import blocks
from tools.bundle import build_wheel

SHIPPED: Final = (
    "edge/models/skyfix.onnx",
    "calib/simulation/scenes/study.toml",
    "calib/simulation/scenes/demo.toml",
    "calib/station/page/static/map.js",
    "calib/station/page/static/station.css",
)
NOT_SHIPPED: Final = ("tests/", "tools/", "deploy/", "systemd/")
# Which extra brings what; a base never detects, a box never solves.
BLOCKED: Final = """
import importlib, pkgutil, sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {absent!r}:
            raise ModuleNotFoundError(f"no {{name}}", name=name)
sys.meta_path.insert(0, Absent())
import {package}
for module in pkgutil.walk_packages({package}.__path__, "{package}."):
    if not module.name.endswith(".__main__") and module.name not in {needing!r}:
        importlib.import_module(module.name)
"""


@dataclass(frozen=True)
class Installed:
    """An environment with the wheel in it, and an empty folder to work in."""

    programs: Path
    folder: Path
    wheel: Path

    def run(self, *command: str) -> "subprocess.CompletedProcess[str]":
        """Run a command there; what it said."""
        path = os.pathsep.join([str(self.programs), os.environ["PATH"]])
        inherited = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        return subprocess.run(
            command, cwd=self.folder, env=inherited | {"PATH": path}, capture_output=True, text=True, check=False
        )


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    folder = tmp_path_factory.mktemp("wheel")
    wheel = build_wheel(folder)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    programs = folder / "venv" / "bin"
    pip = [sys.executable, "-m", "pip", "--python", str(programs / "python"), "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--no-deps", "--no-index", str(wheel)], check=True)
    packages = next((folder / "venv" / "lib").glob("python3.*")) / "site-packages"
    ours = {sysconfig.get_path("purelib"), *(path for path in sys.path if path.endswith("site-packages"))}
    (packages / "libraries.pth").write_text("\n".join(sorted(ours)) + "\n")
    (folder / "elsewhere").mkdir()
    return Installed(programs, folder / "elsewhere", wheel)


def test_every_room_and_all_that_programs_read_is_in_it(installed: Installed) -> None:
    names = set(zipfile.ZipFile(installed.wheel).namelist())
    sources = {str(file.relative_to(ROOT)) for room in ("edge", "calib") for file in (ROOT / room).rglob("*.py")}
    assert sources - names == set()
    assert set(SHIPPED) - names == set()
    assert [name for name in names if name.startswith(NOT_SHIPPED)] == []


def test_it_is_the_wheel_that_is_run(installed: Installed) -> None:
    told = installed.run("python", "-c", "import calib, edge; print(calib.__file__, edge.__file__)")
    places = told.stdout.split()
    assert len(places) == 2, told.stderr
    assert all(Path(place).is_relative_to(installed.programs.parent) for place in places)


def test_the_guides_commands_run(installed: Installed) -> None:
    """All blocks that need no hardware, one after the other, as a reader would."""
    done = installed.run("bash", "-c", "set -euo pipefail\n" + "\n".join(blocks("sh")))
    assert done.returncode == 0, done.stdout + done.stderr
    assert (installed.folder / "out" / "solved" / "report.html").stat().st_size > 100_000
    assert "gx:coord" in (installed.folder / "out" / "flight.kml").read_text()


def test_a_base_can_be_looked_at_and_has_certificates(installed: Installed) -> None:
    """`init` for a bench, `check` of what it wrote, an authority, the router's and the replay's words."""
    for line in (
        "base-station init bench -o bench",
        "base-station certs --folder bench/certs init bench",
        "base-station certs --folder bench/certs issue base --role station --address 127.0.0.1",
        "base-station replay --help",
        "base-station router --help",
        "edge-node --help",
    ):
        done = installed.run(*line.split())
        assert done.returncode == 0, line + done.stderr
    done = installed.run("base-station", "check", "--config", "bench/base.toml")
    assert "Traceback" not in done.stderr
    assert re.search(r"^PASS +state folder", done.stdout, re.MULTILINE), done.stdout + done.stderr


def test_a_base_never_imports_what_only_a_box_has(installed: Installed) -> None:
    done = installed.run("python", "-c", BLOCKED.format(absent=["onnxruntime"], package="calib", needing=[]))
    assert done.returncode == 0, done.stderr


def test_a_router_imports_neither_what_a_box_has_nor_what_a_base_has(installed: Installed) -> None:
    absent = [
        "cv2",
        "onnxruntime",
        "scipy",
        "pymavlink",
        "pymap3d",
        "mcap",
        "matplotlib",
        "prometheus_client",
        "nicegui",
    ]
    script = BLOCKED.partition("import {package}")[0] + "from calib.station.app import main\nmain(['router', '--help'])"
    done = installed.run("python", "-c", script.format(absent=absent))
    assert done.returncode == 0, done.stderr
    assert "router.toml" in done.stdout


def test_a_box_never_imports_what_only_a_base_has(installed: Installed) -> None:
    absent = ["scipy", "pymavlink", "pymap3d", "mcap", "matplotlib", "prometheus_client", "nicegui", "calib"]
    done = installed.run("python", "-c", BLOCKED.format(absent=absent, package="edge", needing=[]))
    assert done.returncode == 0, done.stderr


def test_a_subcommand_without_its_libraries_names_the_extra(installed: Installed) -> None:
    """As on a camera box, whose wheel is the same."""
    script = "import sys\nsys.modules['{absent}'] = None\nfrom calib.station.app import main\nsys.exit(main({words!r}))"
    for absent, words, extra in (
        ("scipy", ["solve", "--help"], "base"),
        ("cryptography", ["certs", "list"], "certs"),
    ):
        done = installed.run("python", "-c", script.format(absent=absent, words=words))
        assert done.returncode == 1, done.stderr
        assert f"{absent} is not installed" in done.stderr
        assert f"pip install 'skyfix[{extra}]'" in done.stderr
