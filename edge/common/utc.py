"""Monotonic time -> UTC, by brackets, with the history kept.

The hazard is the step. A frame is stamped by the driver on the monotonic clock; if UTC is stepped between the frame and
its conversion, the frame is moved by the whole step, and nobody sees it. So the two clocks are compared again and
again, each comparison bracketed (monotonic, UTC, monotonic: one reading alone has been 190 microseconds off), the
comparisons are kept, and a frame is converted with those around its own time. A step is counted and never reaches back.
Between the last comparison before it and the first after it nobody knows which side a frame is on: such a frame may be
off by the whole step, and says so. To keep them few, whoever dates a frame compares the clocks as well.

CLOCK_MONOTONIC only: it stands still in suspend, CLOCK_BOOTTIME (libcamera's stamps) does not, and the two must never
be subtracted from each other.
"""

import threading
import time
from bisect import bisect_right
from collections.abc import Callable
from typing import Final, NamedTuple

BRACKETS: Final = 20  # tries for one comparison; the narrowest is some 140 ns wide
FEW_BRACKETS: Final = 3  # where a step is looked for, and 0.1 ms do not matter; a microsecond in all
HISTORY: Final = 3600  # comparisons kept: an hour of one a second
SLEW_PPM: Final = 1000  # no daemon slews faster once it runs; what exceeds it is a step
STEP_FLOOR_NS: Final = 100_000  # 0.1 ms is 2 mm at 20 m/s: not worth calling a step


class Comparison(NamedTuple):
    """One bracketed reading: UTC minus monotonic at monotonic_ns, known to half of width_ns."""

    monotonic_ns: int
    offset_ns: int
    width_ns: int


def compare(
    monotonic_ns: Callable[[], int] = time.monotonic_ns,
    unix_ns: Callable[[], int] = time.time_ns,
    tries: int = BRACKETS,
) -> Comparison:
    """The narrowest of `tries` brackets."""
    best: Comparison | None = None
    for _ in range(tries):
        before, utc, after = monotonic_ns(), unix_ns(), monotonic_ns()
        middle = (before + after) // 2
        if best is None or after - before < best.width_ns:
            best = Comparison(middle, utc - middle, after - before)
    assert best is not None
    return best


class Dated(NamedTuple):
    """A stamp in UTC, and how far it may be off because UTC was stepped about then: 0 but for a frame or two."""

    t_unix_ns: int
    doubt_s: float


class UtcMapping:
    """Converts monotonic stamps to UTC; safe to use from several threads. Call `refresh` once a second."""

    def __init__(
        self, monotonic_ns: Callable[[], int] = time.monotonic_ns, unix_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._monotonic_ns = monotonic_ns
        self._unix_ns = unix_ns
        self._lock = threading.Lock()
        self._history: list[Comparison] = [compare(monotonic_ns, unix_ns)]
        self._newest = self._history[-1]
        self._stepped: set[int] = set()
        self._steps = 0

    @property
    def steps(self) -> int:
        """How often UTC has been stepped; goes up for good."""
        return self._steps

    def refresh(self) -> Comparison:
        """Compare the clocks once more, and notice a step."""
        new = compare(self._monotonic_ns, self._unix_ns)
        with self._lock:
            self._notice(new)
            self._append(new)
        return new

    def date(self, monotonic_ns: int) -> Dated:
        """UTC of a stamp of just now, after a look whether UTC was stepped since."""
        new = compare(self._monotonic_ns, self._unix_ns, tries=FEW_BRACKETS)
        with self._lock:
            self._notice(new)
            return Dated(monotonic_ns + self._offset_ns(monotonic_ns), self._doubt_ns(monotonic_ns) * 1e-9)

    def unix_ns(self, monotonic_ns: int) -> int:
        """UTC of a monotonic stamp, by the comparisons around it."""
        with self._lock:
            return monotonic_ns + self._offset_ns(monotonic_ns)

    def now_unix_ns(self) -> int:
        """UTC now, and a refresh if it was stepped since the last one."""
        now = compare(self._monotonic_ns, self._unix_ns, tries=FEW_BRACKETS)
        with self._lock:
            self._notice(now)
        return now.monotonic_ns + now.offset_ns

    def _notice(self, new: Comparison) -> None:
        """Keep a comparison only if UTC was stepped before it, with the last one before the step."""
        last = self._newest
        if new.monotonic_ns <= last.monotonic_ns:
            return
        if self._is_step(last, new):
            self._append(last)
            self._append(new)
        self._newest = new

    def _append(self, new: Comparison) -> None:
        last = self._history[-1]
        if new.monotonic_ns <= last.monotonic_ns:
            return
        if self._is_step(last, new):
            self._steps += 1
            self._stepped.add(new.monotonic_ns)
        self._history.append(new)
        if len(self._history) > HISTORY:
            self._stepped.discard(self._history.pop(0).monotonic_ns)

    @staticmethod
    def _is_step(last: Comparison, new: Comparison) -> bool:
        slewed_ns = SLEW_PPM * 1e-6 * (new.monotonic_ns - last.monotonic_ns)
        return abs(new.offset_ns - last.offset_ns) > slewed_ns + STEP_FLOOR_NS + (new.width_ns + last.width_ns) // 2

    def _after(self, monotonic_ns: int) -> int:
        return bisect_right(self._history, monotonic_ns, key=lambda comparison: comparison.monotonic_ns)

    def _doubt_ns(self, monotonic_ns: int) -> int:
        after = self._after(monotonic_ns)
        if not 0 < after < len(self._history) or self._history[after].monotonic_ns not in self._stepped:
            return 0
        return abs(self._history[after].offset_ns - self._history[after - 1].offset_ns)

    def _offset_ns(self, monotonic_ns: int) -> int:
        after = self._after(monotonic_ns)
        if after == 0:
            return self._history[0].offset_ns
        before = self._history[after - 1]
        if after == len(self._history) or self._history[after].monotonic_ns in self._stepped:
            return before.offset_ns
        following = self._history[after]
        share = (monotonic_ns - before.monotonic_ns) / (following.monotonic_ns - before.monotonic_ns)
        return before.offset_ns + round(share * (following.offset_ns - before.offset_ns))
