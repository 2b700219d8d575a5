"""Bundle adjustment in continuous time: all pixels, the survey, the lens reports and the clocks' bounds, at once.

The hazards are a start far off (answered by damping and a loss without pull from afar), weights that are wrong
(weights.py estimates them from the residuals, in turns with the Gauss-Newton steps here), and a gauge that nothing
holds (priors hold it, or the Schur complement refuses). Unknowns and residuals are those of projection.py and
priors.py; the control points are eliminated as Triggs et al. (2000, section 6) eliminate points.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from calib.adjustment.flight import FlightEstimate
from calib.adjustment.joint_prior import JointPrior
from calib.adjustment.noise import robust_cost, robust_weight
from calib.adjustment.normal import Factor, Normal, NormalStep, factorise
from calib.adjustment.priors import CameraPrior, moved
from calib.adjustment.projection import CAMERA_SIZE, CameraData, Projected, project, unknowns_of
from calib.adjustment.smoothness import Smoothness
from calib.adjustment.weights import Fitted, Weights, renewed, steady
from calib.errors import CalibrationError, LensError
from edge.common.arrays import Array

WEIGHT_ROUNDS: Final = 12  # of re-estimated weights; most problems settle in 5
LAST_WEIGHT_ROUNDS: Final = 3  # with all rows, once a part of them is settled
COARSE_ROWS: Final = 8000  # enough for a hundred unknowns at any correlation
FEWEST_KEPT: Final = 100  # of each camera's rows, however many the others have
STEPS: Final = 8  # of Gauss-Newton between two rounds
SETTLE_ROUNDS: Final = 5  # times STEPS: a beginning far off takes longer
SETTLED: Final = 0.03  # squared sigmas: a step that gains less moves nothing by more than a sixth of its sigma
WORST_SIGMAS: Final = 30.0  # what an observation without an image costs
HARDEST_DAMPING: Final = 1e6


@dataclass(frozen=True)
class Problem:
    """What is given: one CameraData and one prior for each camera, in one order throughout.

    widened: (14 C, 14 C) covariance that is added to what the priors claim, where they were found to claim too much.
    beyond: the same of what they are weighed by as claimed nevertheless: it counts in what is stated, not in the
    weights.
    """

    data: tuple[CameraData, ...]
    priors: tuple[CameraPrior, ...]
    widened: Array | None = None
    beyond: Array | None = None

    @cached_property
    def prior(self) -> JointPrior:
        """What is known of all cameras together."""
        return JointPrior(self.priors, self.widened)

    def thinned(self, every: int) -> "Problem":
        """The same problem with only each so-many-th row, but not next to none of any camera's."""
        steps = [max(1, min(every, len(seen.t_s) // FEWEST_KEPT)) for seen in self.data]
        return replace(
            self, data=tuple(seen.rows(slice(None, None, step)) for seen, step in zip(self.data, steps, strict=True))
        )

    @property
    def row_count(self) -> int:
        """Rows of all cameras together."""
        return sum(len(seen.t_s) for seen in self.data)

    @property
    def interval_s(self) -> Array:
        """(C,) time between a camera's frames, whatever number of objects they show."""
        return np.array([np.median(np.diff(np.unique(seen.t_s))) for seen in self.data], float)


@dataclass(frozen=True)
class Adjusted:
    """A settled adjustment: the estimate, its weights, the normal equations there, factorised, and every residual."""

    estimate: FlightEstimate
    weights: Weights
    normal: Normal
    factor: Factor
    projected: tuple[Projected, ...]
    rounds: int


def adjust(problem: Problem, estimate: FlightEstimate, weights: Weights) -> Adjusted:
    """Adjust everything together, weights included, starting with `weights`: rather too wide than too narrow.

    Large problems are settled on a part of their rows first: rows a thirtieth of a second apart say nearly the same.
    Raises CalibrationError if the observations leave a direction undetermined.
    """
    every = problem.row_count // COARSE_ROWS
    if every > 1:
        coarse = problem.thinned(every)
        settled = adjust_rounds(coarse, estimate, replace(weights, interval_s=coarse.interval_s), WEIGHT_ROUNDS)
        weights = replace(settled.weights, interval_s=problem.interval_s)
        return adjust_rounds(problem, settled.estimate, weights, LAST_WEIGHT_ROUNDS)
    return adjust_rounds(problem, estimate, weights, WEIGHT_ROUNDS)


def adjust_rounds(problem: Problem, estimate: FlightEstimate, weights: Weights, rounds: int) -> Adjusted:
    """Adjust all rows, at most `rounds` times with weights renewed in between."""
    for count in range(1, rounds + 1):
        at = _descend(_Point.of(problem, estimate, weights, Smoothness.at(estimate, weights.jerk_weight)))
        estimate, normal = at.estimate, at.normal()
        factor = _factorise(normal)
        new = renewed(weights, estimate, at.fitted(), normal, factor)
        if steady(weights, new) or count == rounds:
            break
        weights = new
    return Adjusted(estimate, weights, normal, factor, at.projected, count)


def settle(problem: Problem, estimate: FlightEstimate, weights: Weights) -> tuple[FlightEstimate, float]:
    """Where an estimate settles under weights that stay, and what it costs there, in squared sigmas.

    Costs under the same weights tell which of several beginnings, or of several sets of priors, explains the rows best:
    minus twice the log of the evidence, up to what all have in common, the cameras integrated out where it settled
    (Laplace; MacKay 1992). Wide priors make any misfit cheap, and pay by the room they had left and did not need.
    Raises CalibrationError if the observations leave a direction undetermined.
    """
    at = _Point.of(problem, estimate, weights, Smoothness.at(estimate, weights.jerk_weight))
    for _ in range(SETTLE_ROUNDS):
        before, at = at.cost(), _descend(at)
        if before - at.cost() < SETTLED:
            break
    left = np.linalg.slogdet(_factorise(at.normal()).camera_covariance)[1]
    room = np.linalg.slogdet(problem.prior.covariance)[1] if problem.prior.known.any() else 0.0
    return at.estimate, at.cost() + float(room - left)


@dataclass(frozen=True)
class _Point:
    """The problem at one estimate under one set of weights."""

    problem: Problem
    estimate: FlightEstimate
    weights: Weights
    smoothness: Smoothness
    projected: tuple[Projected, ...]

    @classmethod
    def of(cls, problem: Problem, estimate: FlightEstimate, weights: Weights, smoothness: Smoothness) -> "_Point":
        pairs = zip(estimate.cameras, problem.data, strict=True)
        images = tuple(project(camera, seen, estimate.flight, estimate.control) for camera, seen in pairs)
        return cls(problem, estimate, weights, smoothness, images)

    def moved(self, step: NormalStep) -> "_Point":
        changes = step.camera.reshape(-1, CAMERA_SIZE)
        cameras = tuple(moved(camera, change) for camera, change in zip(self.estimate.cameras, changes, strict=True))
        estimate = replace(self.estimate, cameras=cameras, control=self.estimate.control + step.control)
        return _Point.of(self.problem, estimate, self.weights, self.smoothness)

    def lengths(self, index: int) -> Array:
        """(N,) residuals of one camera in sigmas: what the robust loss judges, correlated or not."""
        image, seen = self.projected[index], self.problem.data[index]
        sigma = self.weights.sigma_px[index] * seen.sigma_px
        return np.where(image.valid, np.linalg.norm(image.residual, axis=1) / sigma, WORST_SIGMAS)

    def fitted(self) -> tuple[Fitted, ...]:
        """Per camera its data, its residuals and the robust share of each row's weight; fixed unknowns left out."""
        parts = enumerate(zip(self.problem.data, self.projected, self.problem.priors, strict=True))
        return tuple(
            Fitted(
                seen,
                replace(image, by_camera=image.by_camera * np.where(prior.fixed, 0.0, 1.0)),
                robust_weight(self.lengths(index)) * image.valid,
            )
            for index, (seen, image, prior) in parts
        )

    def cost(self) -> float:
        """What the steps reduce: robust residuals, priors, and jerk."""
        total = sum(
            float(robust_cost(self.lengths(index)).sum()) / float(correlated)
            for index, correlated in enumerate(self.weights.correlated)
        )
        return total + self.problem.prior.cost(self.estimate.cameras) + self.smoothness.cost(self.estimate)

    def normal(self) -> Normal:
        """The normal equations of a step from here."""
        normal = Normal.zero(len(self.estimate.control), CAMERA_SIZE * len(self.projected))
        for index, part in enumerate(self.fitted()):
            at = unknowns_of(index)
            sigma = self.weights.weighing_sigma_px[index] * part.data.sigma_px
            whiten = (np.sqrt(part.kept) / sigma)[:, None, None]
            image = part.image
            normal.add_observations(
                image.located, image.by_point * whiten, image.by_camera * whiten, image.residual * whiten[:, 0], at
            )
        self.problem.prior.add_to(normal, self.estimate.cameras)
        self.smoothness.add_to(normal, self.estimate)
        return normal


def _descend(point: _Point) -> _Point:
    """Levenberg-Marquardt under fixed weights."""
    damping, cost = 0.0, point.cost()
    for _ in range(STEPS):
        normal = point.normal()
        while True:
            trial = _trial(point, normal, damping)
            if trial and (trial_cost := trial.cost()) <= cost:
                break
            damping = max(10 * damping, 1e-4)
            if damping > HARDEST_DAMPING:
                return point
        gain, cost, point = cost - trial_cost, trial_cost, trial
        damping = damping / 10 if damping > 1e-6 else 0.0
        if gain < SETTLED:
            break
    return point


def _trial(point: _Point, normal: Normal, damping: float) -> _Point | None:
    """Where a damped step leads; None if the equations have no solution, or one that is no lens."""
    try:
        return point.moved(factorise(normal, damping, slack=False).solve(normal))
    except (np.linalg.LinAlgError, LensError):
        return None


def _factorise(normal: Normal) -> Factor:
    try:
        return factorise(normal)
    except np.linalg.LinAlgError as error:
        raise CalibrationError(
            "the observations leave a direction undetermined",
            where="adjustment",
            action="fly a path with more height and width, or survey more cameras",
        ) from error
