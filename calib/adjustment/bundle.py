"""Bundle adjustment in continuous time: all pixels, the survey, the lens reports and the clocks' bounds, at once.

The hazards are a start far off (answered by damping and a loss without pull from afar), weights that are wrong
(weights.py estimates them from the residuals, in turns with the Gauss-Newton steps here), and a gauge that nothing
holds (priors hold it, or the Schur complement refuses). Unknowns and residuals are those of projection.py and
priors.py; the control points are eliminated as Triggs et al. (2000, section 6) eliminate points.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from calib.adjustment.descent import descend
from calib.adjustment.flight import FlightEstimate
from calib.adjustment.normal import Factor, Normal, factorise, local_covariance
from calib.adjustment.problem import Point, Problem
from calib.adjustment.projection import Projected
from calib.adjustment.weights import Weights, renewed, steady
from calib.errors import CalibrationError
from edge.common.arrays import Array

WEIGHT_ROUNDS: Final = 12  # of re-estimated weights; most problems settle in 5
LAST_WEIGHT_ROUNDS: Final = 3  # with all rows, once a part of them is settled
LEAST_ADJUSTED_PX: Final = 1e-3  # one sigma: no picture tells a centre better
STEPS: Final = 8  # of Gauss-Newton between two rounds
SETTLE_STEPS: Final = 40  # a beginning far off takes longer


@dataclass(frozen=True)
class Adjusted:
    """A settled adjustment: the estimate, its weights, the normal equations there, factorised, and every residual."""

    estimate: FlightEstimate
    weights: Weights
    normal: Normal
    factor: Factor
    projected: tuple[Projected, ...]
    rounds: int

    @cached_property
    def flight_covariance(self) -> Array:
        """(M - 3, 4, 3, 4, 3) of each run of four neighbouring control points, cameras held fixed."""
        return local_covariance(self.normal.block)

    def told_sigma_px(self, index: int) -> float:
        """Sigma of a camera's rows against what they claim, no smaller than a picture tells.

        Rows without noise show only how a file was rounded: what is off by a little more is no worse for it.
        """
        return max(float(self.weights.sigma_px[index]), LEAST_ADJUSTED_PX)


def adjust(problem: Problem, estimate: FlightEstimate, weights: Weights, rounds: int = WEIGHT_ROUNDS) -> Adjusted:
    """Adjust everything together, at most `rounds` times with weights renewed in between.

    weights: to begin with, rather too wide than too narrow. Raises CalibrationError if the observations leave a
    direction undetermined.
    """
    begun = estimate, weights
    for count in range(1, rounds + 1):
        descent = descend(Point.at(problem, estimate, weights), STEPS if count < rounds else SETTLE_STEPS)
        at, normal = descent.point, descent.point.normal()
        estimate = at.estimate
        try:
            factor = _factorise(normal)
        except CalibrationError:
            if weights.sigma_px.min() >= LEAST_ADJUSTED_PX or weights.least_sigma_px >= LEAST_ADJUSTED_PX:
                raise
            # Rows without any noise: weights grew until, beside pixels, a double did not hold the survey any more.
            return adjust(problem, begun[0], begun[1].at_least(LEAST_ADJUSTED_PX), rounds)
        try:
            new = renewed(weights, estimate, at.fitted(), normal, factor)
        except np.linalg.LinAlgError as error:
            raise _undetermined() from error
        if (descent.settled and steady(weights, new)) or count == rounds:
            break
        weights = new
    return Adjusted(estimate, weights, normal, factor, at.projected, count)


def settle(
    problem: Problem, estimate: FlightEstimate, weights: Weights, steps: int = SETTLE_STEPS
) -> tuple[FlightEstimate, float]:
    """Where an estimate settles under weights that stay, or is after so many steps, and its cost in squared sigmas.

    Costs under the same weights tell which of several beginnings, or of several sets of priors, explains the rows best:
    minus twice the log of the evidence, up to what all have in common, the cameras integrated out where it settled
    (Laplace; MacKay 1992). Wide priors make any misfit cheap, and pay by the room they had left and did not need.
    Raises CalibrationError if the observations leave a direction undetermined.
    """
    descent = descend(Point.at(problem, estimate, weights), steps)
    left = np.linalg.slogdet(_factorise(descent.point.normal()).camera_covariance)[1]
    room = np.linalg.slogdet(problem.prior.covariance)[1] if problem.prior.known.any() else 0.0
    return descent.point.estimate, descent.cost + float(room - left)


def _factorise(normal: Normal) -> Factor:
    try:
        return factorise(normal)
    except np.linalg.LinAlgError as error:
        raise _undetermined() from error


def _undetermined() -> CalibrationError:
    return CalibrationError(
        "the observations leave a direction undetermined",
        where="adjustment",
        action="fly a path with more height and width, or survey more cameras",
    )
