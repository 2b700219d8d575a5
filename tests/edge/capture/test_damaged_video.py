"""What is damaged, joined or bare: read as far as it goes, dated as it says, and what is missing is told."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from edge.capture.video import VideoFile
from edge.common.errors import SourceError
from tests.edge.capture.sources import SIZE, T0, encode, frames_of
from tests.edge.footage import sky

pytestmark = pytest.mark.program("ffmpeg")

COUNT = 250
LONG_GROUPS = ["-c:v", "libx264", "-preset", "veryfast", "-bf", "0", "-g", "100", "-sc_threshold", "0", "-crf", "14"]


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    rng = np.random.default_rng(4)
    return [sky(SIZE, [(10 + k / 2, 60)], rng) for k in range(COUNT)]


def seconds(frames: list) -> list[float]:
    return [round((frame.t_unix_ns - T0) / 1e9, 3) for frame in frames]


@pytest.mark.parametrize("seed", range(20))
def test_damage_in_the_middle_is_passed_over_and_told(tmp_path: Path, images: list[np.ndarray], seed: int) -> None:
    rng = np.random.default_rng(seed)
    suffix = ("mp4", "mkv", "ts")[seed % 3]
    file = encode(tmp_path / f"a.{suffix}", images, [*LONG_GROUPS, "-pix_fmt", "yuv420p"])
    data = bytearray(file.read_bytes())
    begin = round(len(data) * rng.uniform(0.3, 0.5))
    length = round(len(data) * rng.uniform(0.1, 0.15))
    data[begin : begin + length] = bytes(length)
    file.write_bytes(data)
    video = VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0)
    times = seconds(frames_of(video))
    assert times[-1] == pytest.approx((COUNT - 1) / 25, abs=0.05), f"seed {seed}"
    assert len(times) > COUNT / 2
    assert any("missing" in remark.what or "decoded" in remark.what for remark in video.remarks)


def test_joined_recordings_go_on_in_time(tmp_path: Path, images: list[np.ndarray]) -> None:
    part = encode(tmp_path / "a.ts", images[:50], [*LONG_GROUPS, "-pix_fmt", "yuv420p"]).read_bytes()
    (tmp_path / "joined.ts").write_bytes(3 * part)
    video = VideoFile(str(tmp_path / "joined.ts"), t0_unix_ns=T0, bound_s=0.001)
    frames = frames_of(video)
    assert seconds(frames) == pytest.approx([k / 25 for k in range(150)], abs=0.002)
    assert [frame.bound_s for frame in (frames[0], frames[49], frames[50], frames[-1])] == [0.001, 0.001, None, None]
    assert len(video.remarks) == 2


def test_recording_that_begins_between_key_frames(tmp_path: Path, images: list[np.ndarray]) -> None:
    whole = encode(tmp_path / "a.ts", images, [*LONG_GROUPS, "-pix_fmt", "yuv420p"])
    drop = ["-c", "copy", "-bsf:v", "noise=drop=lt(n\\,1)"]
    subprocess.run(["ffmpeg", "-y", "-loglevel", "error", "-i", whole, *drop, tmp_path / "b.ts"], check=True)
    video = VideoFile(str(tmp_path / "b.ts"), t0_unix_ns=T0, bound_s=0.0)
    frames = frames_of(video)
    assert len(frames) == 150
    assert seconds(frames)[0] == pytest.approx(3.96, abs=0.05)  # a hundred frames, less the one that was dropped
    assert "do not decode" in video.remarks[0].what


def test_a_made_up_rate_is_not_believed_and_a_given_one_is(tmp_path: Path, images: list[np.ndarray]) -> None:
    bare = encode(tmp_path / "a.mjpeg", images[:30], ["-c:v", "mjpeg", "-q:v", "3", "-f", "mjpeg"])
    with pytest.raises(SourceError, match=r"no times.*source\.fps"):
        VideoFile(str(bare), t0_unix_ns=T0, bound_s=0.0)
    assert seconds(frames_of(VideoFile(str(bare), t0_unix_ns=T0, bound_s=0.0, fps=50.0)))[-1] == 29 / 50


def test_good_times_are_kept_against_a_given_rate(video: Path) -> None:
    source = VideoFile(str(video), t0_unix_ns=T0, bound_s=0.0, fps=30.0)
    assert seconds(frames_of(source))[-1] == 19 / 25
    assert "its own are used" in source.remarks[0].what
    assert VideoFile(str(video), t0_unix_ns=T0, bound_s=0.0, fps=25.0).remarks == []


def test_last_frames_of_an_avi_with_b_frames(tmp_path: Path, images: list[np.ndarray]) -> None:
    file = encode(tmp_path / "b.avi", images[:40], ["-c:v", "mpeg4", "-bf", "2", "-q:v", "2", "-vtag", "XVID"])
    source = VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0, loop=True)
    frames = [source.read() for _ in range(100)]
    assert seconds(frames) == pytest.approx([k / 25 for k in range(100)], abs=0.002)
    assert source.remarks == []
