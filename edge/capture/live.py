"""A network stream, with the best time it can give.

The hazard is a dead camera behind a frozen picture. Every read has a time limit, after which the source is dead by
definition and says so; whoever reads it opens it anew. A frame's time is the driver's or the sender's where there is
one, and where there is none the frame says that it was only seen to arrive.
"""

import time
from collections.abc import Callable
from typing import Any

import cv2

from edge.capture.address import shown, why_not
from edge.capture.decoding import FILLS, first_retrieved, undecoded, unwritten
from edge.capture.frame import Picture, Remark
from edge.capture.grabber import Grabber, dead
from edge.capture.grey import grey
from edge.capture.stamps import FrameRounding
from edge.capture.standing_still import CALIBRATION_S, StillFor
from edge.capture.witnessed_stream import WitnessedStream
from edge.common.utc import Dated


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
        self._still = StillFor()
        self._still_s = 0.0
        self._seen = False

    def read(self) -> Picture | None:
        """The next frame. Raises SourceError when the stream is dead."""
        if not self._capture.grab():
            raise dead(self._path)
        arrival_ns = self._monotonic_ns()
        at_ms = self._capture.get(cv2.CAP_PROP_POS_MSEC)
        image = self._pixels()
        image = image if self._colour else grey(image)
        self._still_s = self._still.seconds(image, arrival_ns)
        stamp = self._clock.stamp(round(at_ms * 1e6), arrival_ns, self._sent_unix_ns(at_ms), self._date)
        return Picture(stamp.t_unix_ns - self._delay_ns, image, stamp.source, stamp.bound_s)

    @property
    def remarks(self) -> list[Remark]:
        """What its times say against each other, and that its picture stands still."""
        if self._still_s <= CALIBRATION_S:
            return self._clock.remarks
        said = f"its picture has not changed by a pixel for {self._still_s:.0f} s"
        action = "look at it: an encoder that hangs, or a camera that was set to interlaced; restart its stream"
        return [Remark(said, action), *self._clock.remarks]

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
            raise dead(self._path)
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


def open_rtsp(path: str, timeout_s: float) -> cv2.VideoCapture:
    """A network stream. Raises SourceError, LoginError if it does not open within the limit."""
    limit_ms = round(timeout_s * 1e3)
    options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 2 * limit_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, limit_ms]
    capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG, [*options, cv2.CAP_PROP_N_THREADS, 1])
    if not capture.isOpened():
        raise why_not(path)
    return capture
