"""Video of every pixel format gives the same pictures as the 8-bit progressive file, or is refused by name."""

from pathlib import Path

import numpy as np
import pytest

from edge.capture.decoding import FILLS, likeness, unwritten
from edge.capture.video import VideoFile
from edge.common.errors import SourceError
from tests.edge.capture.sources import T0, encode, frames_of
from tests.edge.footage import sky

pytestmark = pytest.mark.program("ffmpeg")

SIZE = (320, 240)
COUNT = 8
LOSSLESS = ["-c:v", "ffv1"]
RAW = ["-c:v", "rawvideo"]
H264 = ["-c:v", "libx264", "-crf", "4", "-preset", "ultrafast"]
# Name: whether luma alone may serve, and how ffmpeg makes it.
FORMATS = {
    "yuv420p.mp4": (True, [*H264, "-pix_fmt", "yuv420p"]),
    "yuv444p.mp4": (True, [*H264, "-pix_fmt", "yuv444p"]),
    "yuv420p10.mp4": (False, [*H264, "-pix_fmt", "yuv420p10le"]),
    "yuv422p10.mp4": (False, [*H264, "-pix_fmt", "yuv422p10le"]),
    "gray10.mkv": (False, [*LOSSLESS, "-pix_fmt", "gray10le"]),
    "gray12.mkv": (False, [*LOSSLESS, "-pix_fmt", "gray12le"]),
    "gray16.mkv": (False, [*LOSSLESS, "-pix_fmt", "gray16le"]),
    "yuv422p10.mkv": (False, [*LOSSLESS, "-pix_fmt", "yuv422p10le"]),
    "yuv420p12.mkv": (False, [*LOSSLESS, "-pix_fmt", "yuv420p12le"]),
    "bgr0.mkv": (False, [*LOSSLESS, "-pix_fmt", "bgr0"]),
    "bgr24.avi": (False, [*RAW, "-pix_fmt", "bgr24"]),
    "yuyv422.avi": (False, [*RAW, "-pix_fmt", "yuyv422"]),
    "uyvy422.mov": (False, [*RAW, "-pix_fmt", "uyvy422"]),
    "nv12.mkv": (True, [*RAW, "-pix_fmt", "nv12"]),
    "y800.avi": (True, [*RAW, "-pix_fmt", "gray", "-vtag", "Y800"]),
    "prores.mov": (False, ["-c:v", "prores_ks", "-profile:v", "2", "-pix_fmt", "yuv422p10le"]),
    "png_rgb.mov": (False, ["-c:v", "png", "-pix_fmt", "rgb24"]),
    "png_rgba.mov": (False, ["-c:v", "png", "-pix_fmt", "rgba"]),
    "qtrle.mov": (False, ["-c:v", "qtrle", "-pix_fmt", "rgb24"]),
    "mjpeg.avi": (True, ["-c:v", "mjpeg", "-q:v", "2", "-pix_fmt", "yuvj422p"]),
}


def pictures(count: int = COUNT) -> list[np.ndarray]:
    rng = np.random.default_rng(18)
    ramp = np.linspace(-60, 0, SIZE[0])
    return [
        np.clip(sky(SIZE, [(40 + 20 * k, 60 + 9 * k)], rng, 14.0) + ramp, 0, 255).astype(np.uint8) for k in range(count)
    ]


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_pictures_that_were_filmed(tmp_path: Path, name: str) -> None:
    luma, options = FORMATS[name]
    video = VideoFile(str(encode(tmp_path / name, pictures(), options)), t0_unix_ns=T0, bound_s=0.0)
    frames = frames_of(video)
    assert len(frames) == COUNT
    for frame, wanted in zip(frames, pictures(), strict=True):
        assert frame.image.dtype == np.uint8
        # Measured: 0.995 and more, the noise of the sky lost to the encoders; a picture one frame off has below 0.9.
        assert likeness(frame.image, wanted) > 0.97
    assert video.remarks == []
    assert video._probe.luma == luma


def thermal() -> list[np.ndarray]:
    """Fourteen bits of a thermal camera, of which the scene fills three hundred counts."""
    rng = np.random.default_rng(18)
    across, down = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    shown = []
    for k in range(COUNT):
        image = 8000 + across + rng.normal(0, 6, across.shape)
        image += 250 * np.clip(3.5 - np.hypot(across - 40 - 5 * k, down - 100), 0, 1)
        shown.append(image.astype("<u2"))
    return shown


@pytest.mark.parametrize(("name", "codec"), [("a.mkv", "ffv1"), ("b.mov", "tiff")])
def test_sixteen_bits_are_stretched_by_contrast_and_not_cut(tmp_path: Path, name: str, codec: str) -> None:
    file = encode(tmp_path / name, thermal(), ["-c:v", codec, "-pix_fmt", "gray16le"], "gray16le")
    for colour in (False, True):
        frames = frames_of(VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0, colour=colour))
        assert len(frames) == COUNT
        image = frames[3].image if not colour else frames[3].image[:, :, 0]
        assert len(np.unique(image)) > 60
        assert int(image[100, 55]) - int(image[100, 40]) > 40
        assert likeness(image, np.clip((thermal()[3] - 7900) / 3, 0, 255).astype(np.uint8)) > 0.97


@pytest.mark.parametrize(
    ("codec", "form", "said"), [("png", "gray16be", "big-endian grey of 16 bits"), ("ffv1", "gray12le", "is cut")]
)
def test_what_cannot_be_stretched_is_said_with_what_to_do(tmp_path: Path, codec: str, form: str, said: str) -> None:
    file = encode(tmp_path / "a.mkv", thermal(), ["-c:v", codec, "-pix_fmt", form], "gray16le")
    try:
        video = VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0)
        found = [(remark.what, remark.action) for remark in video.remarks]
    except SourceError as error:
        found = [(error.what, error.action)]
    assert len(found) == 1
    assert said in found[0][0]
    assert "ffmpeg -i FILE -pix_fmt gray16le" in found[0][1]


INTERLACED = {
    "mpeg2.ts": ["-c:v", "mpeg2video", "-q:v", "2", "-flags", "+ildct+ilme", "-top", "1"],
    "h264.mp4": [*H264, "-flags", "+ildct+ilme", "-x264opts", "tff=1", "-pix_fmt", "yuv420p"],
    "h264.ts": [*H264, "-flags", "+ildct+ilme", "-x264opts", "bff=1", "-pix_fmt", "yuv420p"],
}


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("name", INTERLACED)
def test_interlaced_video_is_refused_by_name(tmp_path: Path, name: str, colour: bool) -> None:
    # Pictures of the process that lie about in memory must not be taken for it: a good file of that size first.
    good = encode(tmp_path / "good.mp4", pictures(), FORMATS["yuv420p.mp4"][1])
    frames_of(VideoFile(str(good), t0_unix_ns=T0, bound_s=0.0, colour=colour))
    file = encode(tmp_path / name, pictures(), INTERLACED[name])
    with pytest.raises(SourceError, match=r"interlaced.*yadif"):
        frames_of(VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0, colour=colour))


def test_even_pictures_are_no_fault(tmp_path: Path) -> None:
    even = [np.full((SIZE[1], SIZE[0]), level, np.uint8) for level in (0, 0, FILLS[0] ^ 0xFF, 16, 16)]
    video = VideoFile(
        str(encode(tmp_path / "even.mkv", even, [*LOSSLESS, "-pix_fmt", "yuv420p"])), t0_unix_ns=T0, bound_s=0
    )
    assert len(frames_of(video)) == 5


def test_memory_that_nobody_wrote_is_known() -> None:
    assert unwritten(np.full((4, 4), FILLS[0] ^ 0xFF, np.uint8), FILLS[0])
    assert not unwritten(np.full((4, 4), FILLS[0] ^ 0xFF, np.uint8), FILLS[1])


def test_a_codec_without_a_decoder_is_named(tmp_path: Path) -> None:
    whole = encode(tmp_path / "a.mp4", pictures(), FORMATS["yuv420p.mp4"][1]).read_bytes()
    (tmp_path / "b.mp4").write_bytes(whole.replace(b"avc1", b"av99").replace(b"avcC", b"av9C"))
    with pytest.raises(SourceError, match=r"b\.mp4.*(codec|no video)"):
        frames_of(VideoFile(str(tmp_path / "b.mp4"), t0_unix_ns=T0, bound_s=0.0))
