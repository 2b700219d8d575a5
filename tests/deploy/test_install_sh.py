"""What install.sh says of a machine that cannot be installed, before anything is changed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.places import DEPLOY

OLD_PYTHON = "#!/bin/sh\ncase $2 in *print*) echo 3.9;; *) exit 1;; esac\n"
PYTHONS = ("python3.11", "python3.12", "python3.13", "python3.14", "python3")


def said(folder: Path, script: Path, *words: str, **programs: str) -> "subprocess.CompletedProcess[str]":
    """What it says where these programs are found before all others."""
    (folder / "bin").mkdir(exist_ok=True)
    for name, text in programs.items():
        file = folder / "bin" / name.replace("_", ".")
        file.write_text(text)
        file.chmod(0o755)
    path = os.pathsep.join([str(folder / "bin"), os.environ["PATH"]])
    return subprocess.run(
        ["bash", str(script), *words], env=os.environ | {"PATH": path}, capture_output=True, text=True, check=False
    )


def test_a_32_bit_system_is_told_so(tmp_path: Path) -> None:
    done = said(tmp_path, DEPLOY / "install.sh", "edge", getconf="#!/bin/sh\necho 32\n")
    assert done.returncode == 1
    assert "this is a 32-bit system" in done.stderr
    assert "write a 64-bit image to the card; nothing was changed" in done.stderr


def test_an_old_python_is_told_with_its_version(tmp_path: Path) -> None:
    done = said(tmp_path, DEPLOY / "install.sh", "edge", **{name.replace(".", "_"): OLD_PYTHON for name in PYTHONS})
    assert done.returncode == 1
    assert "no Python 3.11 or later (found: 3.9 3.9 3.9 3.9 3.9)" in done.stderr


def test_an_installer_that_is_not_whole_says_so(tmp_path: Path) -> None:
    shutil.copyfile(DEPLOY / "install.sh", tmp_path / "install.sh")
    done = said(tmp_path, tmp_path / "install.sh", "edge")
    assert done.returncode == 1
    assert "the installer is not whole; unpack the bundle" in done.stderr


@pytest.mark.parametrize("folder", ["with a space", 'wi\'th "quotes"', "größe"])
def test_it_may_lie_in_any_folder(tmp_path: Path, folder: str) -> None:
    (tmp_path / folder).mkdir()
    shutil.copytree(DEPLOY / "installer", tmp_path / folder / "installer")
    shutil.copyfile(DEPLOY / "install.sh", tmp_path / folder / "install.sh")
    done = said(
        tmp_path, tmp_path / folder / "install.sh", "--help", python3_11=f'#!/bin/sh\nexec {sys.executable} "$@"\n'
    )
    assert done.returncode == 0, done.stderr
    assert "edge|base|router|rollback|uninstall" in done.stdout
