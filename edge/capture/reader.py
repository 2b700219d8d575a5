"""A thread that reads one source, so that nothing the detector does can delay the reading.

Live, the newest frame wins: what the detector did not come to is dropped, and counted. From a recording nothing is
dropped: the thread waits for the detector. A live source that dies is opened again, with growing patience, until told
to stop; a recording that cannot be read is at an end, and says why.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import cv2

from edge.capture.frame import FrameSource, Picture, Remark
from edge.common.errors import LoginError, SkyfixError, SourceError
from edge.common.own_thread import OwnThread

log = logging.getLogger(__name__)

READER_CLOSE_S: Final = 1.0  # a driver lets go of a frame within this, or is left to the process's end
WAITING_FRAMES: Final = 2  # frames between capture and detector: more is only delay
FIRST_PATIENCE_S: Final = 0.5  # before a dead source is opened again
LONGEST_PATIENCE_S: Final = 8.0
LOGIN_PATIENCE_S: Final = 300.0  # cameras lock an account for half an hour after five to seven refused logins


@dataclass(frozen=True)
class ReaderState:
    """How the reading goes. last_monotonic_s: when the last frame came, None before the first. error: why none come.
    remarks: what is odd about the source that is open, or was last."""

    frames: int = 0
    dropped: int = 0
    reopened: int = 0
    last_monotonic_s: float | None = None
    time_source: str = ""
    error: SkyfixError | None = None
    ended: bool = False
    remarks: tuple[Remark, ...] = ()


class Reader(OwnThread):
    """Owns the capture thread of one camera. open_source: opens the source, at first and again."""

    def __init__(self, name: str, open_source: Callable[[], FrameSource], *, live: bool, lossless: bool) -> None:
        """live: reopen when the source dies. lossless: wait for the detector rather than drop."""
        super().__init__(f"capture-{name}", READER_CLOSE_S)
        self._open = open_source
        self._live = live
        self._lossless = lossless
        self._frames: deque[Picture] = deque()
        self._changed = threading.Condition()
        self._state = ReaderState()
        self._skipped_before = 0
        self._source: FrameSource | None = None

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()

    @property
    def state(self) -> ReaderState:
        """How it goes, now; `dropped` includes what the source itself passed over."""
        source = self._source
        if source is None:
            return replace(self._state, dropped=self._state.dropped + self._skipped_before)
        skipped = self._skipped_before + source.skipped
        return replace(self._state, dropped=self._state.dropped + skipped, remarks=tuple(source.remarks))

    def get(self, timeout_s: float) -> Picture | None:
        """The next frame, waiting up to timeout_s; None if none came, or none will come any more (`state.ended`)."""
        with self._changed:
            self._changed.wait_for(lambda: self._frames or self._state.ended, timeout_s)
            frame = self._frames.popleft() if self._frames else None
            self._changed.notify_all()
            return frame

    @property
    def finished(self) -> bool:
        """Whether the last frame has been taken and none will follow."""
        with self._changed:
            return self._state.ended and not self._frames

    def _run(self) -> None:
        patience_s = FIRST_PATIENCE_S
        segment = 0
        while not self._stop.is_set():
            before = self._state.frames
            error = self._read_segment(segment)
            if self._stop.is_set() or not self._live:
                self._update(ended=True, error=error)
                return
            log.warning("%s: %s", self._name, error or "the stream ended; opening it again")
            self._update(error=error, reopened=self._state.reopened + 1)
            patience_s = FIRST_PATIENCE_S if self._state.frames > before else min(2 * patience_s, LONGEST_PATIENCE_S)
            self._stop.wait(LOGIN_PATIENCE_S if isinstance(error, LoginError) else patience_s)
            segment += 1
        self._update(ended=True)

    def _read_segment(self, segment: int) -> SkyfixError | None:
        """Read one opening of the source to its end; the error that ended it, if one did."""
        try:
            self._source = self._open()
        except SkyfixError as error:
            return error
        try:
            while not self._stop.is_set() and (frame := self._source.read()) is not None:
                self._put(replace(frame, segment=frame.segment + segment) if segment else frame)
        except SkyfixError as error:
            return error
        except (OSError, ValueError, cv2.error) as error:
            where = f"frame {self._state.frames + 1} of {self._name}"
            return SourceError(f"cannot be read ({error})", where=where, action="check the source, and start again")
        finally:
            self._update(remarks=tuple(self._source.remarks))
            self._skipped_before += self._source.skipped
            source, self._source = self._source, None
            source.close()
        return None

    def _put(self, frame: Picture) -> None:
        with self._changed:
            if self._lossless:
                self._changed.wait_for(lambda: len(self._frames) < WAITING_FRAMES or self._stop.is_set())
            dropped = len(self._frames) >= WAITING_FRAMES
            if dropped:
                self._frames.popleft()
            self._frames.append(frame)
            self._state = replace(
                self._state,
                frames=self._state.frames + 1,
                dropped=self._state.dropped + dropped,
                last_monotonic_s=time.monotonic(),
                time_source=frame.time_source,
                error=None,
            )
            self._changed.notify_all()

    def _update(self, **changes: object) -> None:
        with self._changed:
            self._state = replace(self._state, **changes)  # type: ignore[arg-type]
            self._changed.notify_all()
