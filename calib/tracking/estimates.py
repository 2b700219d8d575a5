"""What a tracker says of a target: the one form in which positions leave the mathematics.

The hazard is a number without its meaning: a position whose instant is not said is wrong by a second of flight, one
whose covariance is not said is believed to the millimetre.
"""

from dataclasses import dataclass
from enum import StrEnum

from edge.common.arrays import Array


class TargetState(StrEnum):
    """The life of a target."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    LOST = "lost"


@dataclass(frozen=True)
class TargetEstimate:
    """Where a target is. covariance: (6, 6) of position and velocity, ENU. age_s: since its last measurement.

    denied_by: cameras that should see it, see other things, and do not see it. ahead: those of `cameras` whose stamps
    lead what two others have come to. rests_on: the network's, cameras whose claims nobody checks.
    """

    track: int
    state: TargetState
    t_unix_ns: int
    position_enu: Array
    velocity_enu: Array
    covariance: Array
    cameras: tuple[str, ...]
    age_s: float
    quality: float
    denied_by: tuple[str, ...] = ()
    ahead: tuple[str, ...] = ()
    rests_on: tuple[str, ...] = ()

    @property
    def witnesses(self) -> int:
        """How many cameras bear it out, each with a stamp that another one's bears out."""
        return len(set(self.cameras) - set(self.ahead))
