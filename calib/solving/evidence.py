"""What the residuals of a finished adjustment show, beyond one number a camera.

The hazard is a calibration that flatters itself: every unknown added makes the residuals smaller, whether or not it is
true. So part of the rows is held back, the rest adjusted again, and the rows held back are predicted; a lens that is
wrong shows as a pattern over the image; and two cameras that never saw the same object say so in the table of pairs.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.bundle import Adjusted, adjust
from calib.adjustment.noise import RAYLEIGH_MEDIAN, robust_weight
from calib.adjustment.problem import Problem
from calib.adjustment.projection import CameraData, Projected, project, site_time_s
from calib.adjustment.uncertainty import prediction_px2
from calib.solving.pixel_information import PriorTest
from calib.solving.series import gap_to_nearest_s
from calib.solving.strain import survey_test
from edge.common.arrays import Array

GRID: Final = (6, 8)  # rows and columns the image is cut into: a lens's errors are smooth, and each cell needs rows
BESIDE_S: Final = 0.1  # two rows this near in time are of one place: 10 Hz cameras share every row
HELD_OUT_S: Final = 3.0  # a stretch held back: longer than a residual correlates, or its neighbours give it away
FEWEST_HELD: Final = 20  # rows, below which a held-out residual says nothing


@dataclass(frozen=True)
class ByPlace:
    """Residuals (predicted minus seen) by place in the image.

    rows: (6, 8) int64 how many; weight: (6, 8) how many of them count, outliers being next to nothing; mean_px:
    (6, 8, 2) of those, NaN where there are none; size_px: of the image.
    """

    rows: NDArray[np.int64]
    weight: Array
    mean_px: Array
    size_px: tuple[int, int]

    @property
    def coverage(self) -> float:
        """Share of the image that the object crossed."""
        return float(np.mean(self.rows > 0))

    @property
    def pattern_px(self) -> float:
        """Root mean square of the cells' means, by their weight: what a wrong lens leaves."""
        seen = self.weight > 0
        square = (self.mean_px[seen] ** 2).mean(axis=1)
        return float(np.sqrt(np.average(square, weights=self.weight[seen]))) if seen.any() else 0.0


@dataclass(frozen=True)
class HeldOut:
    """Rows that were predicted, not fitted. predicted_px: one sigma a coordinate, robust; expected_px: what the
    adjustment without them expected that to be; fitted_px: their residual when they took part; rows: how many.
    """

    rows: int
    predicted_px: float
    expected_px: float
    fitted_px: float


@dataclass(frozen=True)
class Evidence:
    """Per camera, in the order of the network: by_place and held_out (None: too few rows that two others see).

    shared_rows: (C, C) rows of camera i within BESIDE_S of a row of camera j of the same object; diagonal: all rows.
    survey: the surveyed positions against the cameras; None with fewer than three surveyed. covariance: (14 C, 14 C)
    of all the cameras' unknowns in the order of projection.py: an attitude and a principal point err together.
    """

    by_place: tuple[ByPlace, ...]
    held_out: tuple[HeldOut | None, ...]
    shared_rows: NDArray[np.int64]
    survey: PriorTest | None
    covariance: Array


def gather(adjusted: Adjusted, problem: Problem, covariance: Array) -> Evidence:
    """All of it; costs about a round of the adjustment. covariance: (14 C, 14 C) of the cameras' unknowns."""
    near = _near(adjusted, problem)
    shared = np.array([[int(other.sum()) for other in own] for own in near], np.int64)
    places = tuple(
        _by_place(image, data, camera.lens.size_px, sigma_px)
        for image, data, camera, sigma_px in zip(
            adjusted.projected, problem.data, adjusted.estimate.cameras, adjusted.weights.sigma_px, strict=True
        )
    )
    return Evidence(places, _held_out(adjusted, problem, near), shared, survey_test(adjusted, problem), covariance)


def _near(adjusted: Adjusted, problem: Problem) -> list[list[NDArray[np.bool_]]]:
    """near[i][j]: (N_i,) which rows of camera i have a row of camera j of the same object beside them."""
    pairs = zip(adjusted.estimate.cameras, problem.data, strict=True)
    times = [site_time_s(camera, data) for camera, data in pairs]
    return [
        [_beside(times[i], own.target, times[j], other.target) for j, other in enumerate(problem.data)]
        for i, own in enumerate(problem.data)
    ]


def _beside(t_s: Array, target: NDArray[np.int64], other_s: Array, other: NDArray[np.int64]) -> NDArray[np.bool_]:
    found = np.zeros(len(t_s), bool)
    for one in np.unique(target):
        times, mine = np.sort(other_s[other == one]), np.flatnonzero(target == one)
        found[mine] = gap_to_nearest_s(t_s[mine], times) <= BESIDE_S
    return found


def _by_place(image: Projected, data: CameraData, size_px: tuple[int, int], sigma_px: float) -> ByPlace:
    rows, columns = GRID
    length = np.linalg.norm(image.residual, axis=1) / (sigma_px * data.sigma_px)
    weight = np.where(image.valid, robust_weight(length), 0.0)
    u = np.clip((data.pixels[:, 0] / size_px[0] * columns).astype(int), 0, columns - 1)
    v = np.clip((data.pixels[:, 1] / size_px[1] * rows).astype(int), 0, rows - 1)
    cell = v * columns + u
    total = np.bincount(cell, weight, rows * columns)
    sums = [np.bincount(cell, weight * image.residual[:, axis], rows * columns) for axis in range(2)]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.stack([one / total for one in sums], axis=1).reshape(rows, columns, 2)
    count = np.bincount(cell, image.valid, rows * columns).astype(np.int64).reshape(rows, columns)
    return ByPlace(count, np.asarray(total.reshape(rows, columns), float), mean, size_px)


def _held_out(adjusted: Adjusted, problem: Problem, near: list[list[NDArray[np.bool_]]]) -> tuple[HeldOut | None, ...]:
    """Hold back each camera's rows in turn, a stretch at a time, adjust the rest and predict them.

    Only rows that two other cameras see: what one ray leaves open is no test of anything.
    """
    masks = _masks(adjusted, problem, near)
    kept = tuple(data.rows(~mask) for data, mask in zip(problem.data, masks, strict=True))
    again = adjust(replace(problem, data=kept), adjusted.estimate, adjusted.weights, 1)
    results: list[HeldOut | None] = []
    for index, mask in enumerate(masks):
        rows, estimate = problem.data[index].rows(mask), again.estimate
        image = project(estimate.cameras[index], rows, estimate.flight, estimate.control)
        fitted = adjusted.projected[index].residual[mask]
        if int(mask.sum()) < FEWEST_HELD:
            results.append(None)
        else:
            noise = (adjusted.told_sigma_px(index) * rows.sigma_px) ** 2
            expected = float(np.sqrt(np.median(prediction_px2(again, problem, index, image) + noise)))
            results.append(HeldOut(int(mask.sum()), _sigma_px(image.residual), expected, _sigma_px(fitted)))
    return tuple(results)


def _masks(adjusted: Adjusted, problem: Problem, near: list[list[NDArray[np.bool_]]]) -> list[NDArray[np.bool_]]:
    """Which rows to hold back: never two cameras at once, and a stretch of rest after each."""
    count = len(problem.data)
    masks = []
    for index, (camera, data) in enumerate(zip(adjusted.estimate.cameras, problem.data, strict=True)):
        turn = np.floor(site_time_s(camera, data) / HELD_OUT_S).astype(np.int64) % (2 * count) == 2 * index
        others = sum(near[index][j].astype(int) for j in range(count) if j != index)
        masks.append(turn & (others >= 2) & adjusted.projected[index].valid)
    return masks


def _sigma_px(residual: Array) -> float:
    """One sigma a coordinate, from the median length: outliers stay outliers whether or not they were fitted."""
    return float(np.median(np.linalg.norm(residual, axis=1)) / RAYLEIGH_MEDIAN)
