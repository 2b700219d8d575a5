"""Two stations on one state folder: the second is told who the first is, and a killed one keeps nobody out."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from calib.station.archive.state_lock import LOCK, StateLock
from edge.common.errors import ConfigError, SkyfixError

HOLDER = """
import sys
from pathlib import Path
from calib.station.archive.state_lock import StateLock
with StateLock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_the_second_is_refused_with_the_firsts_process_and_not_once_it_was_killed(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == b"held\n"
        with pytest.raises(SkyfixError, match=f"process {first.pid}") as refused, StateLock(tmp_path):
            pass
        # Exit code 1, for systemd to try again: a configuration error would never be.
        assert not isinstance(refused.value, ConfigError)
        first.send_signal(signal.SIGKILL)
        first.wait()
    with StateLock(tmp_path):
        assert (tmp_path / LOCK).read_text() == f"{os.getpid()}\n"


def test_it_is_free_again_after_an_orderly_end_whatever_the_file_holds(tmp_path: Path) -> None:
    (tmp_path / LOCK).write_bytes(os.urandom(5000))
    for _ in range(2):
        with StateLock(tmp_path):
            pass


def test_a_folder_that_cannot_be_written_keeps_nobody_from_tracking(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with StateLock(tmp_path / "file"):
        pass
