"""The fixes of one antenna that stands still, one after another: what each is worth beside those before it.

The hazard is the newest word. A caster hands out another base, the quality stays 4, and the position is a metre away
with a sigma of a centimetre. Of two fixes that contradict each other one is false, and no later one can tell which: so
from then on sigma covers all that was claimed, until somebody who knows says so (a restart, or a survey). The box
holds its own fixes against each other by this, and the base those that come from a box.
"""

import datetime as dt
import math
from typing import Final

from msgspec.structs import replace

from edge.common.units import NS
from edge.gnss.gates import offset_m
from edge.messages import Fix

# m, horizontal and vertical: twice what 95 % of good pairs of occupations differ by, measured on network RTK.
LEAST_CONTRADICTION_M: Final = (0.050, 0.080)
CONTRADICTION_SIGMAS: Final = 4.0  # of both fixes together: a young fix is worth less, and says so
FIRM_SAMPLES: Final = 30  # half a minute at 1 Hz: a shorter fix is too uncertain to accuse another of being wrong
WHAT_TO_DO: Final = (
    "if its tripod was moved, restart the box, then the station; if not, see from which base its corrections come"
)

Offset = tuple[float, float, float]  # east, north, up, m


def contradict(off_m: Offset, sigma_m: Offset, other_sigma_m: Offset) -> bool:
    """Whether two positions of one thing at rest, off_m apart, cannot both be right by what they claim."""
    east, north, up = (math.hypot(one, other) for one, other in zip(sigma_m, other_sigma_m, strict=True))
    horizontal_m = max(LEAST_CONTRADICTION_M[0], CONTRADICTION_SIGMAS * max(east, north))
    vertical_m = max(LEAST_CONTRADICTION_M[1], CONTRADICTION_SIGMAS * up)
    return math.hypot(*off_m[:2]) > horizontal_m or abs(off_m[2]) > vertical_m


def words(off_m: Offset) -> str:
    """Where a position lies that is off_m from another, which the sentence goes on to name."""
    side = "above" if off_m[2] >= 0 else "below"
    return f"{math.hypot(*off_m[:2]):.3f} m beside and {abs(off_m[2]):.3f} m {side}"


class KeptFix:
    """What the fixes so far are worth together. reason: the contradiction among them, empty while there is none."""

    def __init__(self) -> None:
        self.reason = ""
        self._best: Fix | None = None
        self._low: Offset = (0.0, 0.0, 0.0)  # corners of all that was claimed, from the best
        self._high: Offset = (0.0, 0.0, 0.0)

    def forget(self) -> None:
        """What was fixed before is void: the antenna was seen to move, or its own box has taken it back."""
        self.__init__()  # type: ignore[misc]  # as new

    def take(self, fix: Fix) -> Fix:
        """`fix` as it may be used: as it is, or with a sigma that covers what contradicts it."""
        best = self._best
        if best is None or (best.of, best.frame) != (fix.of, fix.frame):
            self.forget()
            self._best = fix
            return fix
        off_m = offset_m(fix, best)
        if contradict(off_m, fix.sigma_m, best.sigma_m):
            self._accuse(off_m, best)
        elif not self.reason and (math.hypot(*fix.sigma_m) < math.hypot(*best.sigma_m) or not _firm(best)):
            self._best = fix
        return self._covering(fix, off_m) if self.reason else fix

    def _accuse(self, off_m: Offset, best: Fix) -> None:
        if not _firm(best) and not self.reason:
            self._best = None
            return
        east, north, up = zip(self._low, off_m, self._high, strict=True)
        self._low, self._high = (min(east), min(north), min(up)), (max(east), max(north), max(up))
        if not self.reason:
            until = dt.datetime.fromtimestamp(best.t_unix_ns / NS, dt.UTC)
            self.reason = f"it is {words(off_m)} where it was until {until:%H:%M:%S} UTC: one of the two is false"

    def _covering(self, fix: Fix, off_m: Offset) -> Fix:
        spread = [
            max(abs(high - off), abs(off - low)) for off, low, high in zip(off_m, self._low, self._high, strict=True)
        ]
        east, north, up = (math.hypot(sigma, m) for sigma, m in zip(fix.sigma_m, spread, strict=True))
        return replace(fix, sigma_m=(east, north, up))


def _firm(fix: Fix) -> bool:
    return fix.samples >= FIRM_SAMPLES
