"""Folders of images give every picture its honest time, and every failure its name."""

import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge.capture.folder import ImageFolder
from edge.common.errors import SourceError
from tests.edge.capture.sources import MS, T0, frames_of


def test_folder_in_order_of_names_with_stamps_from_names(tmp_path: Path) -> None:
    for k in (2, 0, 1):
        cv2.imwrite(str(tmp_path / f"cam_{T0 + k * 50 * MS}.png"), np.full((12, 16), k, np.uint8))
    (tmp_path / "notes.txt").write_text("not an image")
    frames = frames_of(ImageFolder(str(tmp_path), t0_unix_ns=5, bound_s=0.0, fps=30))
    assert [frame.t_unix_ns for frame in frames] == [T0, T0 + 50 * MS, T0 + 100 * MS]
    assert [int(frame.image[0, 0]) for frame in frames] == [0, 1, 2]


def test_folder_without_stamps_counts(tmp_path: Path) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k:03}.png"), np.zeros((12, 16), np.uint8))
    frames = frames_of(ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20))
    assert [frame.t_unix_ns - T0 for frame in frames] == [0, 50 * MS, 100 * MS]


def test_folder_that_grows(tmp_path: Path, until) -> None:
    stop, seen = threading.Event(), []
    source = ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20, follow=True, stop=stop)
    thread = threading.Thread(target=lambda: seen.extend(iter(source.read, None)))
    thread.start()
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k:03}.png"), np.full((12, 16), k, np.uint8))
        assert until(lambda k=k: len(seen) >= k)  # the newest may still be written to
    source.close()
    thread.join(2)
    assert [int(frame.image[0, 0]) for frame in seen] == [0, 1, 2]


def test_broken_image_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"no")
    with pytest.raises(SourceError, match=r"a\.png.*no image"):
        ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20).read()
