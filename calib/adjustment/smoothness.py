"""The prior on the flight: white jerk, so the acceleration is a random walk, as wind and a pilot's hand make it.

The hazard is scale. A smaller flight has less jerk, so a smoothness that counts metres pulls the whole network
together, against a survey that may be weak or, in a local frame, absent. The cost is therefore taken relative to the
flight's own size about its own middle: shrinking or shifting everything together gains nothing. Turning it gains
nothing either, but a sum of squares made linear does not know that: its curvature would hold a roll that two surveyed
cameras leave open, to a few hundredths of a radian. So its curvature along a turn and a scaling is taken out again.

The size is that of the part which two cameras bear on. What nobody sees is held by smoothness alone; counted in, it
flew off to where the flight was so large that jerk cost nothing, and pixels were fitted better than they deserve.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.flight import FlightEstimate, jerk
from calib.adjustment.normal import Normal
from calib.geometry.spline import ORDER, THIRD_DIFFERENCE, Located
from edge.common.arrays import Array

SMALLEST_CURVATURE: Final = 1e-9  # of the largest: a flight in a line does not change when turned about it


@dataclass(frozen=True)
class Smoothness:
    """weight: of a squared jerk integrated over time, for a flight of the size it was made at. borne: (M,) of which
    control points the size is taken. square_reach: sum of their squared distances from their mean, then.
    """

    weight: float
    borne: NDArray[np.bool_]
    square_reach: float

    @classmethod
    def at(cls, estimate: FlightEstimate, weight: float, borne: NDArray[np.bool_]) -> "Smoothness":
        """The prior whose weight holds for flights of this estimate's size. borne: (M,) what two cameras bear on."""
        if not borne.any():
            borne = np.ones_like(borne)
        return cls(weight, borne, float((_about_middle(estimate, borne)[borne] ** 2).sum()))

    def _share(self, estimate: FlightEstimate) -> tuple[Array, float]:
        away = _about_middle(estimate, self.borne)
        return away, self.square_reach / float((away[self.borne] ** 2).sum())

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
        normal.slack = _slack(estimate, away, information)
        # The derivative of the share: what growing would gain is what the jerk then costs more.
        sized = away * self.borne[:, None]
        normal.right_control += self.cost(estimate) * sized / float((sized**2).sum())


def borne_by_two(located: Sequence[tuple[Located, NDArray[np.bool_]]], controls: int) -> NDArray[np.bool_]:
    """(M,) the control points that rows of two cameras or more bear on. located: of each camera, and its valid rows."""
    cameras = np.zeros(controls, np.int64)
    for own, valid in located:
        cameras[np.unique(own.controls()[valid])] += 1
    return cameras >= 2


def _about_middle(estimate: FlightEstimate, borne: NDArray[np.bool_]) -> Array:
    """(M, 3) control points from the mean of those that count: about any fixed point a flight would gain by moving
    away from it.
    """
    away: Array = estimate.control - estimate.control[borne].mean(0)
    return away


def _slack(estimate: FlightEstimate, away: Array, information: float) -> Array:
    """(3M, r) U with U U' the curvature of the prior in the directions that do not change it: three turns, a scale.

    H T (T' H T)^-1 T' H for those directions T: what is left of H has no curvature along them, and all of it across.
    """
    four = estimate.flight.piece_controls[:, None] + np.arange(ORDER)
    directions = np.stack([*(np.cross(axis, away) for axis in np.eye(3)), away])  # (4, M, 3)
    third = np.einsum("k,dnka->dna", THIRD_DIFFERENCE, directions[:, four])
    values, vectors = np.linalg.eigh(information * np.einsum("dna,ena->de", third, third))
    kept = values > SMALLEST_CURVATURE * values[-1]
    third = np.einsum("dna,de->nae", third, vectors[:, kept] / np.sqrt(values[kept]))
    slack = np.zeros((*away.shape, third.shape[-1]))
    for i in range(ORDER):
        np.add.at(slack, four[:, i], information * THIRD_DIFFERENCE[i] * third)
    return slack.reshape(away.size, third.shape[-1])
