"""What a tracker can be set to: the one home of its defaults, which the station's configuration shows.

Kept apart from the tracker, so that a configuration can be read without the filter being loaded.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from calib.tracking.motion import Singer
from edge.common.arrays import Array

NEAR_SIGMA_M: Final = 6.0  # m: what a target at any range may be uncertain by: two seconds of coasting in a calm flight


@dataclass(frozen=True)
class Limits:
    """What a target can be: how far from its cameras, how fast."""

    max_range_m: float = 3000.0
    max_speed_m_s: float = 100.0
    min_range_m: float = 2.0


@dataclass(frozen=True)
class TrackerOptions:
    """How targets are followed; the station's configuration has keys of the same names under [tracking]."""

    reorder_horizon_s: float = 0.5  # an out-of-sequence measurement may be so late and still count
    coast_s: float = 2.5  # without a measurement for so long a target is lost
    max_sigma_m: float = 150.0  # of position, one sigma, largest axis: more is no use to anybody
    max_sigma_share: float = 0.05  # of the range from the nearest camera: so far off, less is of use
    motion: Singer = field(default_factory=Singer)
    limits: Limits = field(default_factory=Limits)

    def most_sigma_m(self, range_m: Array) -> Array:
        """(N,) how uncertain targets at these ranges (N,) may be, one sigma, and still be said to be somewhere."""
        return np.minimum(self.max_sigma_m, np.maximum(self.max_sigma_share * range_m, NEAR_SIGMA_M))
