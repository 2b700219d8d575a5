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


@pytest.mark.parametrize("seed", range(900, 906))
def test_what_an_avi_has_lost_is_told_for_it_dates_by_counting(
    tmp_path: Path, images: list[np.ndarray], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    file = encode(tmp_path / "a.avi", images, ["-c:v", "mpeg4", "-q:v", "2"])
    whole = VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0)
    assert len(frames_of(whole)) == COUNT
    assert whole.remarks == []
    data = file.read_bytes()
    begin = round(len(data) * rng.uniform(0.2, 0.6))
    file.write_bytes(data[:begin] + data[begin + round(len(data) * rng.uniform(0.06, 0.2)) :])
    video = VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0)
    frames_of(video)
    assert any("are not there" in remark.what or "missing" in remark.what for remark in video.remarks), f"seed {seed}"


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


def stripes(k: int, size: tuple[int, int] = (320, 240)) -> np.ndarray:
    """A picture that says its number in black and white."""
    image = np.full(size[::-1], 90, np.uint8)
    for bit in range(8):
        image[80:160, bit * 40 : bit * 40 + 40] = 220 if k >> bit & 1 else 30
    return image


X264 = ["-c:v", "libx264", "-bf", "2", "-crf", "8", "-pix_fmt", "yuv420p"]
WIDE = ["-vf", "scale=256:144"]
OTHERS = {  # what a recording goes on with, and what is said of it
    "h264 of another size": ([*WIDE, *X264], X264, "256 x 144 and not 320 x 240"),
    "h264 interlaced": ([*X264, "-flags", "+ildct+ilme", "-x264opts", "tff=1"], X264, "interlaced"),
    "hevc of another size": (
        [*WIDE, "-c:v", "libx265", "-x265-params", "log-level=none"],
        ["-c:v", "libx265", "-x265-params", "log-level=none"],
        "256 x 144 and not 320 x 240",
    ),
    "mpeg2 of another size": ([*WIDE, "-c:v", "mpeg2video"], ["-c:v", "mpeg2video", "-q:v", "2"], "256 x 144"),
    "h264 of ten bits": ([*X264[:-1], "yuv420p10le"], X264, ""),
    "h264 of another rate": (["-r", "20", *X264], X264, ""),
}


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("kind", OTHERS)
def test_what_a_recording_changes_to_is_right_or_left_out(tmp_path: Path, kind: str, colour: bool) -> None:
    """A camera that starts anew in another mode: OpenCV stretches it to the first size, or leaves the last picture."""
    other, usual, said = OTHERS[kind]
    first = encode(tmp_path / "a.ts", [stripes(k) for k in range(170)], usual)  # longer than what is doubted early
    middle = encode(tmp_path / "b.ts", [stripes(170 + k) for k in range(30)], other)
    last = encode(tmp_path / "c.ts", [stripes(200 + k) for k in range(30)], usual)
    (tmp_path / "all.ts").write_bytes(b"".join(part.read_bytes() for part in (first, middle, last)))
    video = VideoFile(str(tmp_path / "all.ts"), t0_unix_ns=T0, bound_s=0.0, colour=colour)
    numbers = []
    for frame in frames_of(video):
        row = (frame.image if frame.image.ndim == 2 else frame.image[:, :, 0])[120, 20::40]
        numbers.append(sum(int(grey > 125) << bit for bit, grey in enumerate(row)))
    allowed = [k for k in range(230) if not said or not 170 <= k < 200]
    assert numbers == sorted(set(numbers) & set(allowed))
    # MPEG-2's decoder loses the last picture before a change; of another rate, 6 of 30 are not there.
    assert len(numbers) >= len(allowed) - (6 if "rate" in kind else 2)
    assert said in "; ".join(remark.what for remark in video.remarks)


@pytest.mark.parametrize("codec", ["mpeg4", "libx264", "libx265", "mpeg2video", "mjpeg", "libvpx", "ffv1"])
def test_parameters_of_one_recording_are_one(tmp_path: Path, codec: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No key frame of a recording is opened by itself: MPEG-4's have a time where MPEG-2's have the size."""
    opened: list[str] = []
    monkeypatch.setattr("edge.capture.packets.shown_size", lambda packet, suffix: opened.append(suffix))
    file = encode(
        tmp_path / "a.mkv", [stripes(k) for k in range(50)], ["-c:v", codec, "-g", "5", "-pix_fmt", FORM[codec]]
    )
    assert len(frames_of(VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0))) == 50
    assert opened == []


FORM = dict.fromkeys(("mpeg4", "libx264", "libx265", "mpeg2video", "libvpx"), "yuv420p") | {
    "mjpeg": "yuvj420p",
    "ffv1": "yuv420p",
}


def test_a_recorder_that_hung_is_left_out_from_the_third_repeat_on(tmp_path: Path) -> None:
    shown = [*range(160), *[159] * 40, *range(160, 200), 199, 199]
    file = encode(tmp_path / "hung.mkv", [stripes(k) for k in shown], ["-c:v", "ffv1"])
    video = VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0)
    assert len(frames_of(video)) == len(shown) - 38
    assert ["38 pictures from 6.5 s on are the one before again" in one.what for one in video.remarks] == [True]
