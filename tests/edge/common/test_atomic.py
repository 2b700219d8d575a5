"""A file is replaced whole or not at all."""

import stat
from pathlib import Path

import pytest

from edge.common.atomic import write_atomically


def test_replaces_the_content_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    file = tmp_path / "state"
    write_atomically(file, b"old")
    write_atomically(file, b"new", mode=0o600)
    assert file.read_bytes() == b"new"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert list(tmp_path.iterdir()) == [file]


def test_a_failed_write_keeps_the_old_file(tmp_path: Path) -> None:
    file = tmp_path / "state"
    file.mkdir()  # a rename onto a folder fails after the temporary file was written
    with pytest.raises(OSError, match="state"):
        write_atomically(file, b"new")
    assert list(tmp_path.iterdir()) == [file]
