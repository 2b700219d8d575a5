"""Wheels are laid as pip lays them, but for what nobody loads, and take as much of a disk as is asked for."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from deploy.installer import slimming
from deploy.installer.unpacking import BLOCK_B, laid, size_of, unpack_wheel, write_programs
from tools.bundle import build_wheel

FILES = {
    "room/__init__.py": b"x = 1\n",
    "room/library.so": b"\x7fELF no library" * 1000,
    "room/tests/test_room.py": b"assert 1\n",
    "room-1.data/purelib/room/pure.py": b"y = 2\n",
    "room-1.data/platlib/room/plat.py": b"z = 3\n",
    "room-1.data/scripts/room": b"#!python\n",
    "room-1.data/data/share/man/room.1": b"manual\n",
    "room-1.dist-info/licenses/tests/LICENSE.h": b"a licence\n",
}
LAID = {"room/__init__.py", "room/library.so", "room/pure.py", "room/plat.py"} | {
    "room-1.dist-info/licenses/tests/LICENSE.h"
}


@pytest.fixture
def wheel(tmp_path: Path) -> Path:
    file = tmp_path / "room-1-py3-none-any.whl"
    with zipfile.ZipFile(file, "w") as archive:
        archive.mkdir("room")
        for name, content in FILES.items():
            archive.writestr(name, content)
    return file


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_what_is_loaded_is_laid_and_nothing_else(wheel: Path, tmp_path: Path) -> None:
    unpack_wheel(wheel, tmp_path / "packages")
    assert names(tmp_path / "packages") == LAID
    assert (tmp_path / "packages/room/plat.py").read_bytes() == b"z = 3\n"


def test_as_much_is_asked_for_as_the_disk_then_has_less(wheel: Path, tmp_path: Path) -> None:
    unpack_wheel(wheel, tmp_path / "packages")
    taken = sum(
        -(-file.stat().st_size // BLOCK_B) * BLOCK_B for file in (tmp_path / "packages").rglob("*.*") if file.is_file()
    )
    assert size_of(wheel) == taken


def test_a_wheel_that_leads_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "bad-1-py3-none-any.whl"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("../outside.py", "")
    with pytest.raises(zipfile.BadZipFile, match="leads out"):
        unpack_wheel(file, tmp_path / "packages")
    assert not (tmp_path / "outside.py").exists()


def test_our_own_wheel_is_as_pip_lays_it(tmp_path: Path) -> None:
    """pip writes programs and its own notes beside; what is loaded is the same."""
    own = build_wheel(tmp_path)
    unpack_wheel(own, tmp_path / "ours")
    words = [
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
        "--no-compile",
        "--target",
        str(tmp_path / "pips"),
        str(own),
    ]
    subprocess.run([sys.executable, "-m", "pip", "--disable-pip-version-check", *words], check=True)
    slimming.slim(tmp_path / "pips")
    theirs = {name for name in names(tmp_path / "pips") if not name.startswith("bin/")}
    notes = {name for name in theirs if name.rsplit("/", 1)[-1] in ("INSTALLER", "REQUESTED", "direct_url.json")}
    assert names(tmp_path / "ours") == theirs - notes
    with zipfile.ZipFile(own) as archive:
        assert {name for _, name in laid(archive)} == names(tmp_path / "ours")


def test_the_programs_start(tmp_path: Path) -> None:
    write_programs(tmp_path, sys.executable)
    for name in ("edge-node", "base-station"):
        words = [str(tmp_path / name), "--version"]
        assert subprocess.run(words, capture_output=True, env=os.environ | {"PYTHONPATH": "."}, check=True).stdout
