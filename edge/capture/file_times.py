"""When each frame of a recording was taken, by the times that its file carries. Pure: what the file says is handed in.

The hazard is the time that is none. A raw stream has a frame rate that the reader made up; a file whose camera started
anew, or whose pieces were joined, begins its times again in the middle; the last frames of some AVI files have none. So
a file's own times are told from made up ones at its beginning, time goes on where the file's begins again, and what
came after such a break carries no bound, for nobody knows how long the break was.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

PAUSE_S: Final = 0.5  # s without a frame that are told: longer than a camera that changes its rate
PAUSE_INTERVALS: Final = 5.0  # and so many times the usual distance, for slow cameras
JUMP_S: Final = 60.0  # s ahead that are a clock's jump rather than a pause: what comes after has no bound
RATES_ALIKE: Final = 0.02  # share by which a frame rate that is given may differ from that of the file's times
ELEMENTARY: Final = (
    b"\xff\xd8\xff",
    b"\x00\x00\x00\x01",
    b"\x00\x00\x01",
)  # JPEG, Annex B, MPEG video without container
PROGRAM_STREAM: Final = b"\x00\x00\x01\xba"  # begins like one of those, and carries times


def has_no_container(head: bytes) -> bool:
    """Whether a file that begins so is a bare stream: what is said of its times was made up by its reader."""
    return head.startswith(ELEMENTARY) and not head.startswith(PROGRAM_STREAM)


def carry_times(first_ms: Sequence[float]) -> bool:
    """Whether the times of a file's first frames, in ms, rise as times do: at least half of the steps."""
    rising = sum(b > a for a, b in itertools.pairwise(first_ms))
    return 2 * rising >= len(first_ms) - 1


def usual_interval_s(first_ms: Sequence[float]) -> float | None:
    """The median distance of a file's first frames; None where there are too few or none."""
    steps = sorted(b - a for a, b in itertools.pairwise(first_ms) if b > a)
    return steps[len(steps) // 2] / 1e3 if steps else None


@dataclass
class FileTimes:
    """The time of each frame since the first, ns. fps: where the file carries none. usual_s: distance of its frames.
    length_s: what the file says of its length."""

    fps: float | None = None
    usual_s: float | None = None
    length_s: float = 0.0
    count: int = 0
    breaks: list[tuple[float, float]] = field(default_factory=list)  # s: where we were, where the file's time went
    gaps: list[tuple[float, float]] = field(default_factory=list)  # s: from, to
    late_s: float = 0.0  # s of the beginning that did not decode
    _shift_ms: float | None = None
    _last_ns: int = 0
    _interval_ns: int = 0

    @property
    def bounded(self) -> bool:
        """Whether the times so far hang together, so that a bound for the first holds for the last."""
        return not self.breaks and not self.late_s

    @property
    def next_ns(self) -> int:
        """When the frame after the last one would be."""
        return self._last_ns + self._interval_ns

    def next(self, at_ms: float, *, known: bool = True) -> int:
        """The time of one more frame, at at_ms by the file. known: whether the file gave that frame a time at all."""
        t_ns = self._next(at_ms, known)
        if self.count and t_ns > self._last_ns:
            self._interval_ns = t_ns - self._last_ns
        self._last_ns = t_ns
        self.count += 1
        return t_ns

    def _next(self, at_ms: float, known: bool) -> int:
        if self.fps is not None:
            return round(self.count / self.fps * 1e9)
        if self._shift_ms is None:
            self._shift_ms = self._begin_ms(at_ms)
        if not known:
            return self.next_ns
        t_ns = round((at_ms - self._shift_ms) * 1e6)
        if t_ns < self._last_ns or t_ns - self._last_ns > JUMP_S * 1e9:
            return self._go_on(at_ms, t_ns)
        gap_s = (t_ns - self._last_ns) / 1e9
        if self.count and gap_s > max(PAUSE_S, PAUSE_INTERVALS * (self.usual_s or 0.0)):
            self.gaps.append((self._last_ns / 1e9, t_ns / 1e9))
        return t_ns

    def _begin_ms(self, at_ms: float) -> float:
        """The file's time that is 0: the first frame's, or the file's own where what comes before does not decode."""
        late = PAUSE_S * 1e3 <= at_ms <= self.length_s * 1e3
        self.late_s = at_ms / 1e3 if late else 0.0
        self._last_ns = round(self.late_s * 1e9)
        return 0.0 if late else at_ms

    def _go_on(self, at_ms: float, t_ns: int) -> int:
        """A time that begins again, or jumps: a jump ahead is kept, for it may be a pause; time never goes back."""
        self.breaks.append((self._last_ns / 1e9, t_ns / 1e9))
        if t_ns > self._last_ns:
            return t_ns
        self._shift_ms = at_ms - self.next_ns / 1e6
        return self.next_ns
