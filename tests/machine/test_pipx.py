"""The wheel is one that `pipx install` serves, without the internet: of the bundle's own wheels, with system Python.

No machine is booted for it.
"""

import os
import subprocess
from pathlib import Path

import pytest

from edge import __version__

pytestmark = pytest.mark.program("pipx")


def test_both_programs_are_there(built: Path, tmp_path: Path) -> None:
    offline = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(built / "wheels"), "PIP_CONFIG_FILE": os.devnull}
    places = {"PIPX_HOME": str(tmp_path / "home"), "PIPX_BIN_DIR": str(tmp_path / "bin")}
    python = {"PIPX_DEFAULT_PYTHON": "/usr/bin/python3"}  # for which the bundle was made
    words = ["pipx", "install", "skyfix[base]"]
    done = subprocess.run(
        words, env=os.environ | offline | places | python, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for program in ("edge-node", "base-station"):
        told = subprocess.run([tmp_path / "bin" / program, "--version"], capture_output=True, text=True, check=True)
        assert told.stdout.endswith(f" {__version__}\n")
    solve = [tmp_path / "bin/base-station", "solve", "--help"]
    assert "usage" in subprocess.run(solve, capture_output=True, text=True, check=True).stdout
