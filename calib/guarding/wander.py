"""How far each clock that states no bound was off some seconds ago, as the rays showed it.

The hazard is to take a wander for a step, or a step for a wander. A consumer's camera is off its calibration by tens of
milliseconds after a minute, and nobody is at fault; but it does not get there within seconds. So such a clock is held
against what it itself showed a little earlier, as far as the flight told it then.
"""

from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from edge.common.arrays import Array

UNDISCIPLINED_SIGMA_S: Final = 0.05  # of a clock that states nothing: by so much it may wander between calibrations
WANDER_SIGMA_S: Final = 0.004  # of such a clock, against itself some ten seconds ago
SETTLED_NS: Final = 8_000_000_000  # ago: longer than evidence is kept, so that no step of the last seconds is in it
KEPT_NS: Final = 40_000_000_000


@dataclass(frozen=True)
class ClockEstimate:
    """Of all cameras' clocks (C,): how far they are off the calibration, s, and one sigma."""

    off_s: Array
    sigma_s: Array


class ClockWander:
    """The estimates of the last half minute."""

    def __init__(self) -> None:
        self._past: deque[tuple[int, ClockEstimate]] = deque()

    def clear(self) -> None:
        """Forget all."""
        self._past.clear()

    def add(self, t_unix_ns: int, found: ClockEstimate) -> None:
        """Take an estimate from a window that ended then and speaks of no fault."""
        self._past.append((t_unix_ns, found))
        while self._past[0][0] < t_unix_ns - KEPT_NS:
            self._past.popleft()

    def expected(self, t_unix_ns: int, cameras: int) -> ClockEstimate:
        """What to expect of clocks that state no bound."""
        off_s, sigma_s = np.zeros(cameras), np.full(cameras, UNDISCIPLINED_SIGMA_S)
        for then_ns, found in self._past:
            if then_ns <= t_unix_ns - SETTLED_NS:
                off_s = found.off_s
                sigma_s = np.minimum(np.hypot(found.sigma_s, WANDER_SIGMA_S), UNDISCIPLINED_SIGMA_S)
        return ClockEstimate(off_s, sigma_s)
