"""The prior on the flight: white jerk, so the acceleration is a random walk, as wind and a pilot's hand make it.

The hazard is shape. A smaller flight has less jerk, so a smoothness that counts metres pulls the whole network
together, against a survey that may be weak or, in a local frame, absent; and one that takes jerk to be alike in all
directions pulls a flight together along the one in which it is livelier. Seen by two cameras side by side, a drone that
flew to and fro came out 55 m off that way, and its lenses were blamed. So the cost is that of the flight taken back, by
the linear map nearest to it, to the shape it had before a descent: moving, turning, scaling or stretching everything
together gains nothing. A sum of squares made linear does not know that, so its curvature along those maps is taken out
again.

The shape is that of the part which two cameras bear on. What nobody sees is held by smoothness alone; counted in, it
flew off to where the flight was so large that jerk cost nothing, and pixels were fitted better than they deserve.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.flight import FlightEstimate, jerk
from calib.adjustment.normal import Normal
from calib.geometry.spline import ORDER, THIRD_DIFFERENCE, Located
from edge.common.arrays import Array

FLAT: Final = 1e-10  # of the flight's second moment: an extent that is smaller is none
SMALLEST_CURVATURE: Final = 1e-9  # of the largest: a flight in a line does not change when turned about it


@dataclass(frozen=True)
class Smoothness:
    """weight: of a squared jerk integrated over time, for a flight shaped as it was made at. borne: (M,) of which
    control points the shape is taken. reach: (B, 3) where those were then, about their mean.
    """

    weight: float
    borne: NDArray[np.bool_]
    reach: Array

    @classmethod
    def at(cls, estimate: FlightEstimate, weight: float, borne: NDArray[np.bool_]) -> "Smoothness":
        """The prior whose weight holds for flights of this estimate's shape. borne: (M,) what two cameras bear on."""
        if not borne.any():
            borne = np.ones_like(borne)
        return cls(weight, borne, _about_middle(estimate, borne)[borne])

    @cached_property
    def _by_reach(self) -> tuple[Array, Array]:
        """(3, B) that fits a linear map to what a flight of that reach has become, (3, 3) what it adds for no extent.

        Fitted this way, not back: what flies off by itself would otherwise shrink the map, and its own cost with it.
        """
        least = FLAT * max(float((self.reach**2).sum()), 1.0) * np.eye(3)
        inverse = np.linalg.inv(self.reach.T @ self.reach + least)
        return inverse @ self.reach.T, least @ inverse

    def _back(self, away: Array) -> Array:
        """The linear map (3, 3) that takes a flight back to where it was."""
        fit, least = self._by_reach
        return np.asarray(np.linalg.inv((fit @ away[self.borne]).T + least), float)

    def cost(self, estimate: FlightEstimate) -> float:
        """What the flight's jerk costs, in squared sigmas."""
        back = self._back(_about_middle(estimate, self.borne))
        third = jerk(estimate.flight, estimate.control) @ back.T
        return float((third**2).sum()) * estimate.flight.spacing_s * self.weight

    def add_to(self, normal: Normal, estimate: FlightEstimate) -> None:
        """Add it to the normal equations of a step from the estimate."""
        first, h = estimate.flight.piece_controls, estimate.flight.spacing_s
        third = jerk(estimate.flight, estimate.control)
        away = _about_middle(estimate, self.borne)
        back = self._back(away)
        information = self.weight / h**5 * (back.T @ back)
        for i in range(ORDER):
            np.add.at(normal.right_control, first + i, -(h**3) * THIRD_DIFFERENCE[i] * third @ information)
            for k in range(ORDER - i):
                value = THIRD_DIFFERENCE[i] * THIRD_DIFFERENCE[i + k] * information
                np.add.at(normal.block[k], first + i, value)
        normal.slack = _slack(estimate, away, information)
        # The derivative of the map back: what a change of shape would gain is what the jerk then costs more.
        pulled = h * self.weight * back.T @ (back @ third.T @ third @ back.T)
        normal.right_control[self.borne] += (pulled @ self._by_reach[0]).T


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


def _slack(estimate: FlightEstimate, away: Array, information: Array) -> Array:
    """(3M, r) U with U U' the curvature of the prior in the directions that do not change it: the nine of a linear map.

    H T (T' H T)^-1 T' H for those directions T: what is left of H has no curvature along them, and all of it across.
    information: (3, 3) of a third difference.
    """
    four = estimate.flight.piece_controls[:, None] + np.arange(ORDER)
    directions = np.array([np.outer(away[:, k], axis) for axis in np.eye(3) for k in range(3)])  # (9, M, 3)
    third = np.einsum("k,dnka->dna", THIRD_DIFFERENCE, directions[:, four])
    values, vectors = np.linalg.eigh(np.einsum("dna,enb,ab->de", third, third, information, optimize=True))
    kept = values > SMALLEST_CURVATURE * values[-1]
    unit = vectors[:, kept] / np.sqrt(values[kept])
    third = np.einsum("dna,ab,de->nbe", third, information, unit, optimize=True)
    slack = np.zeros((*away.shape, third.shape[-1]))
    for i in range(ORDER):
        np.add.at(slack, four[:, i], THIRD_DIFFERENCE[i] * third)
    return slack.reshape(away.size, third.shape[-1])
