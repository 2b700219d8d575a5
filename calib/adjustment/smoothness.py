"""The prior on the flight: white jerk, so the acceleration is a random walk, as wind and a pilot's hand make it.

The hazard is scale. A smaller flight has less jerk, so a smoothness that counts metres pulls the whole network
together, against a survey that may be weak or, in a local frame, absent. The cost is therefore taken relative to the
flight's own size about its own middle: shrinking or shifting everything together gains nothing.
"""

from dataclasses import dataclass

import numpy as np

from calib.adjustment.flight import FlightEstimate, jerk
from calib.adjustment.normal import Normal
from calib.geometry.spline import ORDER, THIRD_DIFFERENCE
from edge.common.arrays import Array


@dataclass(frozen=True)
class Smoothness:
    """weight: of a squared jerk integrated over time, for a flight of the size it was made at. square_reach: sum of
    the squared distances of the control points from their mean, then.
    """

    weight: float
    square_reach: float

    @classmethod
    def at(cls, estimate: FlightEstimate, weight: float) -> "Smoothness":
        """The prior whose weight holds for flights of this estimate's size."""
        return cls(weight, float((_about_middle(estimate) ** 2).sum()))

    def _share(self, estimate: FlightEstimate) -> tuple[Array, float]:
        away = _about_middle(estimate)
        return away, self.square_reach / float((away**2).sum())

    def cost(self, estimate: FlightEstimate) -> float:
        """What the flight's jerk costs, in squared sigmas."""
        _, share = self._share(estimate)
        third = jerk(estimate.flight, estimate.control)
        return float((third**2).sum()) * estimate.flight.spacing_s * self.weight * share

    def add_to(self, normal: Normal, estimate: FlightEstimate) -> None:
        """Add it to the normal equations of a step from the estimate."""
        first, h = estimate.flight.piece_controls, estimate.flight.spacing_s
        third = jerk(estimate.flight, estimate.control)
        away, share = self._share(estimate)
        information = h * self.weight * share / h**6
        for i in range(ORDER):
            np.add.at(normal.right_control, first + i, -information * h**3 * THIRD_DIFFERENCE[i] * third)
            for k in range(ORDER - i):
                value = information * THIRD_DIFFERENCE[i] * THIRD_DIFFERENCE[i + k]
                np.add.at(normal.block[k], first + i, value * np.eye(3))
        # The derivative of the share: what growing would gain is what the jerk then costs more.
        normal.right_control += self.cost(estimate) * away / float((away**2).sum())


def _about_middle(estimate: FlightEstimate) -> Array:
    """(M, 3) control points from their mean: about any fixed point a flight would gain by moving away from it."""
    away: Array = estimate.control - estimate.control.mean(0)
    return away
