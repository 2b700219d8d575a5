"""Pixels out of a video file, and whether they are the camera's.

Two hazards, both with `retrieve()` saying True. With CONVERT_RGB off OpenCV hands out the first plane's bytes as they
lie, which is the luma of planar 8-bit video and garbage of all else: 10 bits, packed YUV, RGB. And where its converter
gives up, as of interlaced video, it leaves the picture's memory as it was: remains of earlier pictures. So luma alone
is only asked for formats known to be planar and 8-bit, and held against the colour path on a first picture; and the
memory of first pictures is filled with a known value before, so that a picture nobody wrote is known by it.
"""

import ctypes
import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from edge.capture.address import shown
from edge.capture.frame import Image
from edge.capture.grey import grey
from edge.common.errors import SourceError

log = logging.getLogger(__name__)

# CAP_PROP_CODEC_PIXEL_FORMAT of video whose first plane is 8-bit luma, one byte a pixel: 4:2:0, 4:2:2 and 4:4:4 planar,
# 4:2:0 with interleaved colour, 4:1:1, 4:1:0, grey.
PLANAR_8_BIT: Final = frozenset({"I420", "NV12", "NV21", "Y42B", "444P", "Y41B", "YUV9", "Y800", "GREY"})
DEEP_GREY: Final = "Y1\0\x10"  # FFmpeg's gray16le, which OpenCV hands out as it is
DEEP_GREY_SWAPPED: Final = "\x10\x001Y"  # gray16be, which it takes for eight bits
GREY_BITS: Final = "Y1\0"  # and how many: FFmpeg's gray10le, gray12le, gray14le
POOR_RANGE: Final = 16  # grey levels
DEEP_GREY_ARGS: Final = "-pix_fmt gray16le -c:v ffv1"
ALIKE: Final = 0.95  # correlation of luma and the grey of colours: above 0.99 for the same picture, 0.6 for torn ones
EVEN_STD_GREY: Final = 1.0  # grey levels: a picture more even than this correlates with nothing
TRIED_GRABS: Final = 2000  # packets that may fail in a row: a minute of them; at a true end they cost milliseconds
PROBED_FRAMES: Final = 9  # whose times are looked at: eight steps
CAPTURE_OPTIONS: Final = "OPENCV_FFMPEG_CAPTURE_OPTIONS"  # the environment is OpenCV's only way to say how to open
# Microseconds and bytes: for recordings whose first key frame, which tells their size, comes only after five seconds.
LOOK_FURTHER: Final = "analyzeduration;60000000|probesize;100000000"
M_PERTURB: Final = -6  # glibc's mallopt: what new memory is filled with, the complement of the value
FILLS: Final = (0xA5, 0x3C)  # two values: no picture is evenly the one and then evenly the other


@dataclass(frozen=True)
class Probe:
    """What a file's first frames show. luma: whether luma alone may be decoded. first_ms: their times by the file.
    deep: whether they are grey of sixteen bits, which colours would cut to their upper eight.
    cut: whether they were cut to a few grey levels."""

    luma: bool
    first_ms: tuple[float, ...]
    deep: bool = False
    cut: bool = False


def probe(path: str, *, colour: bool) -> Probe:
    """A look at a file's first frames. Raises SourceError if it does not open, or if what comes out is no picture."""
    capture = opened(path)
    try:
        grabbed = any(capture.grab() for _ in range(TRIED_GRABS))
        times = [capture.get(cv2.CAP_PROP_POS_MSEC)] if grabbed else []
        while grabbed and len(times) < PROBED_FRAMES and capture.grab():
            times.append(capture.get(cv2.CAP_PROP_POS_MSEC))
        form = pixel_format(capture)
    finally:
        capture.release()
    if form == DEEP_GREY_SWAPPED:
        action = f"convert it: ffmpeg -i FILE {DEEP_GREY_ARGS} NEW.mkv"
        raise SourceError("its pictures are big-endian grey of 16 bits, which are not read", where=path, action=action)
    if form == DEEP_GREY:
        return Probe(False, tuple(times), deep=True)
    in_colour = first_picture(path, luma=False) if grabbed else None
    luma = not colour and in_colour is not None and luma_is_true(path, form, in_colour)
    return Probe(luma, tuple(times), cut=form.startswith(GREY_BITS) and in_colour is not None and is_poor(in_colour))


def is_poor(image: Image) -> bool:
    """Whether a picture holds so few grey levels that what it was made of had more."""
    low, high = np.percentile(grey(image)[::4, ::4], (0.5, 99.5))
    return bool(high - low < POOR_RANGE)


def fourcc(capture: Any) -> str:
    """The four letters of a capture's codec."""
    return int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode("ascii", "replace")


def opened(path: str) -> cv2.VideoCapture:
    """An opened capture of a file, in colour, its pictures untried. Raises SourceError if it does not open."""
    if not Path(path).is_file():
        raise SourceError("no such file", where=shown(path), action="give the path of a video file")
    capture = _capture(path)
    if capture.isOpened() and not capture.get(cv2.CAP_PROP_FRAME_WIDTH):
        capture.release()
        with _OPENING:  # the environment is the process's
            os.environ[CAPTURE_OPTIONS] = LOOK_FURTHER
            try:
                capture = _capture(path)
            finally:
                del os.environ[CAPTURE_OPTIONS]
    if not capture.isOpened():
        raise SourceError("is no video that can be opened", where=path, action="play it to check it, or convert it")
    return capture


def _capture(path: str) -> cv2.VideoCapture:
    # One decoding thread: two cost more CPU in all, and the box has other cameras.
    return cv2.VideoCapture(path, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])


def pixel_format(capture: Any) -> str:
    """The four letters that OpenCV has for the format of a capture's pixels; empty where it has none."""
    code = int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT))
    return code.to_bytes(4, "little").decode("ascii", "replace").strip("\0") if code > 0 else ""


def luma_is_true(path: str, form: str, in_colour: Image) -> bool:
    """Whether the luma path gives the first picture that the colour path gave. form: of its pixels, four letters."""
    if form not in PLANAR_8_BIT:
        return False
    in_luma = first_picture(path, luma=True)
    alike = in_luma is not None and likeness(in_luma, grey(in_colour)) >= ALIKE
    if not alike:
        log.warning(
            "%s: its luma (%s) is not the grey of its colours; it is read in colour, which costs more", path, form
        )
    return alike


def likeness(one: Image, other: Image) -> float:
    """Correlation of two grey pictures; 1 where one of them is even and says nothing, 0 for different sizes."""
    if one.shape != other.shape or one.ndim != 2:
        return 0.0
    a, b = one[::2, ::2].astype(np.float64).ravel(), other[::2, ::2].astype(np.float64).ravel()
    if a.std() < EVEN_STD_GREY and b.std() < EVEN_STD_GREY:
        return 1.0
    if a.std() == 0 or b.std() == 0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


def first_picture(path: str, *, luma: bool) -> Image | None:
    """The first picture that decodes; None if none does. Raises SourceError if the decoder says so and wrote none."""
    return picture_at(path, 0, luma=luma)


def picture_at(path: str, index: int, *, luma: bool) -> Image | None:
    """The frame of a number, decoded by a capture of its own; None if it does not decode.

    Raises SourceError if the decoder says that it decoded it and wrote nothing.
    """
    image = _picture_after(path, index, FILLS[0], luma=luma)
    if image is None or not unwritten(image, FILLS[0]):
        return image
    image = _picture_after(path, index, FILLS[1], luma=luma)
    if image is not None and unwritten(image, FILLS[1]):
        raise undecoded(path)
    return image


def undecoded(where: str) -> SourceError:
    """The error of video that the decoder claims to decode and does not."""
    action = "set the camera to progressive; convert a file: ffmpeg -i FILE -vf yadif -c:v libx264 -crf 14 NEW.mp4"
    return SourceError("its pictures are interlaced, which the decoder leaves undecoded", where=where, action=action)


def _picture_after(path: str, index: int, fill: int, *, luma: bool) -> Image | None:
    capture = opened(path)
    if luma:
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    try:
        grabbed = [capture.grab() for _ in range(index)]
        if not all(grabbed) or not any(capture.grab() for _ in range(TRIED_GRABS)):
            return None
        return first_retrieved(capture, fill, luma=luma)
    finally:
        capture.release()


def first_retrieved(capture: Any, fill: int, *, luma: bool = False) -> Image | None:
    """The first picture out of a capture, into memory that is filled before; None if it does not decode."""
    with filled_memory(fill):
        ok, image = retrieve_luma(capture) if luma else capture.retrieve()
    return image if ok else None


def retrieve_luma(capture: Any) -> tuple[bool, Any]:
    """A capture's frame in luma, without OpenCV's warning of it, which comes once a frame."""
    with _QUIET:
        return capture.retrieve()  # type: ignore[no-any-return]


def unwritten(image: Image, fill: int) -> bool:
    """Whether an image holds nothing but what its memory was filled with."""
    value = fill ^ 0xFF
    return bool(image.dtype == np.uint8 and image.size and image.flat[0] == value and (image == value).all())


@contextmanager
def filled_memory(fill: int) -> Iterator[None]:
    """New memory holds the complement of `fill`, so that what nobody wrote shows; without glibc as ever."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        yield
        return
    with _FILLING:
        mallopt(M_PERTURB, fill)
        try:
            yield
        finally:
            mallopt(M_PERTURB, 0)


_FILLING: Final = threading.Lock()  # the setting is the process's
_OPENING: Final = threading.Lock()


class _Quiet:
    """Silences warnings while anybody retrieves luma: OpenCV has one log level for the whole process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0

    def __enter__(self) -> None:
        with self._lock:
            self._count += 1
            cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._count -= 1
            if not self._count:
                cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_WARNING)


_QUIET: Final = _Quiet()
