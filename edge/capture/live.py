"""Live sources: a V4L2 camera and an RTSP stream, each with the best time it can give.

The hazard is a dead camera behind a frozen picture. Every read has a time limit, after which the source is dead by
definition and says so; whoever reads it opens it anew. A frame's time is the driver's or the sender's where there is
one, and where there is none the frame says that it was only seen to arrive.
"""

import time
from collections.abc import Callable
from typing import Any, Final, Protocol

import cv2

from edge.capture.address import shown, why_not
from edge.capture.decoding import FILLS, first_retrieved, undecoded, unwritten
from edge.capture.frame import Picture, Remark, StampOf, middle_of_exposure
from edge.capture.grey import grey
from edge.capture.stamps import ARRIVAL_BOUND_S, SENSOR_BOUND_S, FrameRounding
from edge.capture.witnessed_stream import WitnessedStream
from edge.common.errors import SourceError
from edge.common.utc import Dated

MONOTONIC_PLAUSIBLE_S: Final = 10.0  # s: a driver stamp further than this from now is of another clock


class Grabber(Protocol):
    """The part of cv2.VideoCapture that is used here; a test can stand in for a driver."""

    def isOpened(self) -> bool:
        """Whether it opened."""

    def grab(self) -> bool:
        """Go to the next frame."""

    def retrieve(self) -> tuple[bool, Any]:
        """The frame's pixels."""

    def get(self, prop: int, /) -> float:
        """A property."""

    def set(self, prop: int, value: float, /) -> bool:
        """Set a property."""

    def release(self) -> None:
        """Close it."""


class V4l2Camera:
    """A camera of this box. Driver stamps are CLOCK_MONOTONIC at the instant `stamp_of`; else arrival counts.

    date: UTC of a monotonic stamp.
    """

    live = True
    skipped = 0

    @property
    def remarks(self) -> list[Remark]:
        """Nothing so far."""
        return []

    def __init__(
        self,
        capture: Grabber,
        path: str,
        *,
        colour: bool,
        stamp_of: StampOf = "middle",
        exposure_s: float = 0.0,
        readout_s: float = 0.0,
        delay_s: float = 0.0,
        date: Callable[[int], Dated],
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._capture = capture
        self._path = path
        self._colour = colour
        self._stamp_of: StampOf = stamp_of
        self._exposure_s, self._readout_s, self._delay_ns = exposure_s, readout_s, round(delay_s * 1e9)
        self._date = date
        self._monotonic_ns = monotonic_ns

    def read(self) -> Picture | None:
        """The next frame. Raises SourceError when the camera is dead."""
        if not self._capture.grab():
            raise _dead(self._path)
        arrival_ns = self._monotonic_ns()
        stamp_ns = round(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        ok, image = self._capture.retrieve()
        if not ok:
            raise _dead(self._path)
        stamped = 0 <= arrival_ns - stamp_ns < MONOTONIC_PLAUSIBLE_S * 1e9
        monotonic_ns = stamp_ns if stamped else arrival_ns
        dated = self._date(monotonic_ns)
        return Picture(
            middle_of_exposure(dated.t_unix_ns - self._delay_ns, self._stamp_of, self._exposure_s, self._readout_s),
            image if self._colour else grey(image),
            "sensor" if stamped else "arrival",
            (SENSOR_BOUND_S if stamped else ARRIVAL_BOUND_S) + dated.doubt_s,
        )

    def close(self) -> None:
        """Let go of the device."""
        self._capture.release()


class RtspStream:
    """A network camera. Its sender reports give UTC; before the first, the least delayed arrival does.

    Arrivals are measured by the monotonic clock, which never steps, and dated at the end. date: UTC of such a stamp.
    """

    live = True
    skipped = 0

    def __init__(
        self,
        capture: Grabber,
        path: str,
        *,
        colour: bool,
        delay_s: float = 0.0,
        date: Callable[[int], Dated],
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._capture = capture
        self._path = path
        self._colour = colour
        self._delay_ns = round(delay_s * 1e9)
        self._date = date
        self._monotonic_ns = monotonic_ns
        self._rounding = FrameRounding()
        self._clock = WitnessedStream()
        self._seen = False

    def read(self) -> Picture | None:
        """The next frame. Raises SourceError when the stream is dead."""
        if not self._capture.grab():
            raise _dead(self._path)
        arrival_ns = self._monotonic_ns()
        at_ms = self._capture.get(cv2.CAP_PROP_POS_MSEC)
        image = self._pixels()
        image = image if self._colour else grey(image)
        stamp = self._clock.stamp(round(at_ms * 1e6), arrival_ns, self._sent_unix_ns(at_ms), self._date)
        return Picture(stamp.t_unix_ns - self._delay_ns, image, stamp.source, stamp.bound_s)

    @property
    def remarks(self) -> list[Remark]:
        """What its times say against each other."""
        return self._clock.remarks

    def _pixels(self) -> Any:
        """The frame's picture; the first of a stream is held against what its memory was filled with."""
        if self._seen:
            ok, image = self._capture.retrieve()
        else:
            image = first_retrieved(self._capture, FILLS[0])
            ok = image is not None
            if image is not None and unwritten(image, FILLS[0]):
                raise undecoded(shown(self._path))
        if not ok or image is None:
            raise _dead(self._path)
        self._seen = True
        return image

    def _sent_unix_ns(self, at_ms: float) -> int | None:
        """The sender's time of the frame: its opening time plus the presentation time, unrounded."""
        opened_us = self._capture.get(cv2.CAP_PROP_STREAM_OPEN_TIME_USEC)
        fps = self._capture.get(cv2.CAP_PROP_FPS)
        if opened_us <= 0 or fps <= 0:
            return None
        offset_ms = self._rounding.offset_ms(self._capture.get(cv2.CAP_PROP_PTS) / fps * 1e3, at_ms)
        return round(opened_us * 1e3 + (at_ms + offset_ms) * 1e6)

    def close(self) -> None:
        """Close the stream."""
        self._capture.release()


def open_v4l2(
    path: str, size_px: tuple[int, int] | None, pixel_format: str | None, fps: float | None, timeout_s: float
) -> cv2.VideoCapture:
    """A camera device, asked for size, format and rate. Raises SourceError if it does not open or obey."""
    capture = cv2.VideoCapture(path, cv2.CAP_V4L2, [cv2.CAP_PROP_READ_TIMEOUT_MSEC, round(timeout_s * 1e3)])
    if not capture.isOpened():
        action = "check the cable, `ls /dev/video*`, and that this user is in the group video"
        raise SourceError("the camera does not open", where=path, action=action)
    if pixel_format:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*pixel_format))
    if size_px:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
    if fps:
        capture.set(cv2.CAP_PROP_FPS, fps)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 2)  # one to fill, one to read: more is only delay
    return capture


def open_rtsp(path: str, timeout_s: float) -> cv2.VideoCapture:
    """A network stream. Raises SourceError, LoginError if it does not open within the limit."""
    limit_ms = round(timeout_s * 1e3)
    options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 2 * limit_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, limit_ms]
    capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG, [*options, cv2.CAP_PROP_N_THREADS, 1])
    if not capture.isOpened():
        raise why_not(path)
    return capture


def _dead(path: str) -> SourceError:
    action = "check cable and power; it is opened again by itself"
    return SourceError("the camera gives no more frames", where=shown(path), action=action)
