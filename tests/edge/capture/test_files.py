"""Recordings and folders give every frame its honest time, and every failure its name."""

import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge.capture.files import ImageFolder, VideoFile
from edge.common.errors import SourceError
from tests.edge.capture.sources import MS, SIZE, T0, frames_of
from tests.edge.footage import sky, write_video


def test_every_frame_comes_at_its_own_time(video: Path) -> None:
    frames = frames_of(VideoFile(str(video), t0_unix_ns=T0, bound_s=0.002))
    assert [frame.t_unix_ns - T0 for frame in frames] == [round(k * 40 * MS) for k in range(20)]
    assert {(frame.time_source, frame.bound_s, frame.size_px) for frame in frames} == {("file", 0.002, SIZE)}
    assert frames[0].image.ndim == 2


def test_loop_goes_on_in_time_as_another_segment(video: Path) -> None:
    source = VideoFile(str(video), t0_unix_ns=T0, bound_s=0.0, loop=True)
    frames = [source.read() for _ in range(45)]
    assert [frame.t_unix_ns - T0 for frame in frames] == [k * 40 * MS for k in range(45)]
    assert [frames[k].segment for k in (0, 19, 20, 44)] == [0, 0, 1, 2]


def test_colour_where_it_is_needed(video: Path) -> None:
    assert VideoFile(str(video), t0_unix_ns=T0, bound_s=0.0, colour=True).read().image.shape == (120, 160, 3)


@pytest.mark.parametrize(
    ("content", "said"), [(None, "no such file"), (b"", "no video"), (b"not a video at all" * 50, "no video")]
)
def test_what_is_no_video_is_named(tmp_path: Path, content: bytes | None, said: str) -> None:
    file = tmp_path / "bad.mp4"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SourceError, match=rf"bad\.mp4.*{said}"):
        VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0)


def test_a_file_cut_off_ends_without_an_error(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    whole = write_video(tmp_path / "whole.avi", [sky(SIZE, [(5.0 * k, 50)], rng) for k in range(20)])
    (tmp_path / "cut.avi").write_bytes(whole.read_bytes()[: whole.stat().st_size * 4 // 5])
    assert 0 < len(frames_of(VideoFile(str(tmp_path / "cut.avi"), t0_unix_ns=T0, bound_s=0.0))) < 20


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
