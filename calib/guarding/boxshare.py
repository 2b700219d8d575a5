"""By what share of its width a box's centre is off its object: learnt from how well cameras agree.

The hazard is the detector that prefers one end of its object: its boxes are off by half their width, for as long as the
object keeps its attitude, and every camera looks as if it were knocked. So before agreement was seen half a width is
allowed, at two sigma; every slice in which cameras agree, or do not, tells more. What it tells counts only seconds
later, and never from slices that speak of a fault: else a slow tilt would be learnt as a habit of the detector.
"""

from typing import Final

import numpy as np

from calib.guarding.evidence import ObjectEvidence
from calib.guarding.objects import AGREE

FIRST_SHARE: Final = 0.25  # one sigma, before anything was seen
FIRST_SLICES: Final = 1.5  # slices of one object that this is worth
LARGEST_SHARE: Final = 0.7
MEMORY_SLICES: Final = 240.0  # of one object: what was learnt longer ago is forgotten


class BoxShare:
    """One sigma of a box's centre, of its width."""

    def __init__(self) -> None:
        self._sum = FIRST_SLICES * FIRST_SHARE**2
        self._count = FIRST_SLICES

    @property
    def sigma(self) -> float:
        """As of now."""
        return float(np.sqrt(self._sum / self._count))

    def learn(self, found: ObjectEvidence) -> None:
        """Take one object's slice that speaks of no fault."""
        if sum(found.agree) < AGREE:
            return
        share2 = found.spread_px2 / float(np.mean(found.width_px**2))
        self._sum += min(share2, LARGEST_SHARE**2)
        self._count += 1.0
        if self._count > MEMORY_SLICES:
            self._sum, self._count = self._sum * MEMORY_SLICES / self._count, MEMORY_SLICES
