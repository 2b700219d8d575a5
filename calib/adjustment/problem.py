"""What is adjusted: what is given of all cameras, and its residuals, cost and normal equations at one estimate."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.flight import FlightEstimate
from calib.adjustment.joint_prior import JointPrior
from calib.adjustment.noise import robust_cost, robust_weight
from calib.adjustment.normal import Normal, NormalStep
from calib.adjustment.priors import CameraPrior, moved
from calib.adjustment.projection import CAMERA_SIZE, CameraData, Projected, project, unknowns_of
from calib.adjustment.smoothness import Smoothness, borne_by_two
from calib.adjustment.weights import Fitted, Weights
from calib.geometry.spline import Located
from edge.common.arrays import Array

COARSE_ROWS: Final = 8000  # enough for a hundred unknowns at any correlation
FEWEST_KEPT: Final = 100  # of each camera's rows, however many the others have
WORST_SIGMAS: Final = 30.0  # what an observation without an image costs


@dataclass(frozen=True)
class Problem:
    """What is given: one CameraData and one prior for each camera, in one order throughout.

    widened: (14 C, 14 C) covariance that is added to what the priors claim, where they were found to claim too much.
    beyond: the same of what they are weighed by as claimed nevertheless: it counts in what is stated, not in the
    weights. whole: whether there are no more rows than these.
    """

    data: tuple[CameraData, ...]
    priors: tuple[CameraPrior, ...]
    widened: Array | None = None
    beyond: Array | None = None
    whole: bool = True

    @cached_property
    def prior(self) -> JointPrior:
        """What is known of all cameras together."""
        return JointPrior(self.priors, self.widened)

    @property
    def part(self) -> "Problem":
        """As much of it as weights and doubts are settled by: neighbouring rows say nearly the same."""
        every = self.row_count // COARSE_ROWS
        return replace(self.thinned(every), whole=False) if every > 1 else self

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
class Point:
    """The problem at one estimate under one set of weights."""

    problem: Problem
    estimate: FlightEstimate
    weights: Weights
    smoothness: Smoothness
    projected: tuple[Projected, ...]

    @classmethod
    def at(cls, problem: Problem, estimate: FlightEstimate, weights: Weights) -> "Point":
        """A point, the flight's size being what smoothness is relative to."""
        images = _images(problem, estimate)
        borne = borne_by_two([(image.located, image.valid) for image in images], len(estimate.control))
        return cls(problem, estimate, weights, Smoothness.at(estimate, weights.jerk_weight, borne), images)

    @classmethod
    def of(cls, problem: Problem, estimate: FlightEstimate, weights: Weights, smoothness: Smoothness) -> "Point":
        """A point of a prior on the flight that stays."""
        return cls(problem, estimate, weights, smoothness, _images(problem, estimate))

    def moved(self, step: NormalStep) -> "Point":
        """Where a step leads. Raises LensError if it makes a camera's lens none."""
        changes = step.camera.reshape(-1, CAMERA_SIZE)
        cameras = tuple(moved(camera, change) for camera, change in zip(self.estimate.cameras, changes, strict=True))
        estimate = replace(self.estimate, cameras=cameras, control=self.estimate.control + step.control)
        return Point.of(self.problem, estimate, self.weights, self.smoothness)

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

    def whitened(self) -> tuple["Whitened", ...]:
        """Per camera its rows as they are weighed."""
        parts = []
        for index, part in enumerate(self.fitted()):
            sigma = self.weights.weighing_sigma_px[index] * part.data.sigma_px
            whiten, image = np.asarray(np.sqrt(part.kept) / sigma)[:, None], part.image
            by_point, by_camera = image.by_point * whiten[:, :, None], image.by_camera * whiten[:, :, None]
            parts.append(Whitened(image.located, by_point, by_camera, image.residual * whiten, whiten))
        return tuple(parts)

    def normal(self) -> Normal:
        """The normal equations of a step from here."""
        normal = Normal.zero(len(self.estimate.control), CAMERA_SIZE * len(self.projected))
        for index, part in enumerate(self.whitened()):
            part.add_to(normal, unknowns_of(index))
        self.problem.prior.add_to(normal, self.estimate.cameras)
        self.smoothness.add_to(normal, self.estimate)
        return normal

    def bent(self, step: NormalStep, share: float, ahead: "Point", normal: Normal) -> Normal:
        """The normal equations of what a step lacks because residuals are no straight lines along it: half their second
        derivative along the step, from those at a share of it, `ahead`.
        """
        bending = replace(
            normal, right_control=np.zeros_like(normal.right_control), right_camera=np.zeros_like(normal.right_camera)
        )
        for index, part in enumerate(self.whitened()):
            at, there = unknowns_of(index), ahead.projected[index]
            moved_m = np.einsum("nk,nkd->nd", part.located.weights(), step.control[part.located.controls()])
            straight = np.einsum("nij,nj->ni", part.by_point, moved_m) + part.by_camera @ step.camera[at]
            reached = there.residual * part.weight * there.valid[:, None]
            half = ((reached - part.residual) / share - straight) / share * there.valid[:, None]
            bending.add_pull(part.located, part.by_point, part.by_camera, half, at)
        return bending


@dataclass(frozen=True)
class Whitened:
    """One camera's rows: where on the spline, derivatives (N, 2, 3) and (N, 2, 14) and residuals (N, 2) in sigmas, and
    the weight (N, 1) that made them so.
    """

    located: Located
    by_point: Array
    by_camera: Array
    residual: Array
    weight: Array

    def rows(self, which: NDArray[np.bool_]) -> "Whitened":
        """Only some of the rows."""
        return Whitened(
            self.located.rows(which),
            self.by_point[which],
            self.by_camera[which],
            self.residual[which],
            self.weight[which],
        )

    def add_to(self, normal: Normal, at: slice) -> None:
        """Add them to normal equations, the camera's unknowns standing there."""
        normal.add_observations(self.located, self.by_point, self.by_camera, self.residual, at)


def _images(problem: Problem, estimate: FlightEstimate) -> tuple[Projected, ...]:
    pairs = zip(estimate.cameras, problem.data, strict=True)
    return tuple(project(camera, seen, estimate.flight, estimate.control) for camera, seen in pairs)
