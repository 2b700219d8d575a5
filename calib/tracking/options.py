"""What a tracker can be set to: the one home of its defaults, which the station's configuration shows.

Kept apart from the tracker, so that a configuration can be read without the filter being loaded.
"""

from dataclasses import dataclass, field

from calib.tracking.motion import Singer


@dataclass(frozen=True)
class Limits:
    """What a target can be: how far from its cameras, how fast."""

    max_range_m: float = 3000.0
    max_speed_m_s: float = 80.0
    min_range_m: float = 2.0


@dataclass(frozen=True)
class TrackerOptions:
    """How targets are followed; the station's configuration has keys of the same names under [tracking]."""

    reorder_horizon_s: float = 0.5  # an out-of-sequence measurement may be so late and still count
    coast_s: float = 2.5  # without a measurement for so long a target is lost
    max_sigma_m: float = 6.0  # of position, one sigma, largest axis: more is no use to anybody
    motion: Singer = field(default_factory=Singer)
    limits: Limits = field(default_factory=Limits)
