"""Video files give every frame its honest time, and every failure its name."""

from pathlib import Path

import numpy as np
import pytest

from edge.capture.video import VideoFile
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
