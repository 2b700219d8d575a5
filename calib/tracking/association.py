"""Data association: which detection is which target, by gating and global nearest neighbour over all of them at once.

The hazard is greed. Two objects that cross are each nearest to the other's detection for a moment; giving each
detection to its nearest target swaps them; giving all detections to all targets at the least total cost mostly
does not.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from calib.tracking.filterbank import Expected, Rays
from edge.common.arrays import Array

GATE: Final = 16.0  # squared Mahalanobis distance, 2 degrees of freedom: 3 true ones in 10 000 fall outside
SAME_LABEL_BONUS: Final = 4.0  # squared sigma: what a camera's own track number is worth where two targets cross
DETECTED: Final = 0.8  # how often a camera that sees a target reports it
CLUTTER_A_FRAME: Final = 1.0
MISSED: Final = math.log(1 - DETECTED)  # log-likelihood that a target that is there is not reported


@dataclass(frozen=True)
class Pairing:
    """Targets (M,), the detections (M,) that are theirs, and at best the log-likelihood ratio against clutter (M,)."""

    which: NDArray[np.intp]
    detection: NDArray[np.intp]
    gain: Array

    def __len__(self) -> int:
        return len(self.which)


@dataclass(frozen=True)
class PossiblePairs:
    """What target and detection may be one (N, K), whether the label says so (N, K); confirmed targets (N,)."""

    possible: NDArray[np.bool_]
    same: NDArray[np.bool_]
    confirmed: NDArray[np.bool_]


def pair(expected: Expected, rays: Rays, size_px: tuple[int, int], candidates: PossiblePairs) -> Pairing:
    """Which target is which detection. Confirmed targets choose first; what they leave is the tentative ones'."""
    possible, same, confirmed = candidates.possible, candidates.same, candidates.confirmed
    if not possible.any():
        return Pairing(np.empty(0, np.intp), np.empty(0, np.intp), np.empty(0))
    mahalanobis2, determinant = _distances(expected, rays)
    odds = math.log(DETECTED * math.prod(size_px) / CLUTTER_A_FRAME / (2 * math.pi)) - np.log(determinant) / 2
    worth = np.minimum(2 * (odds - MISSED), GATE)
    cost = np.where(possible & (mahalanobis2 < GATE), mahalanobis2 - worth, 0.0)
    cost = np.where(same & (cost < 0), cost - SAME_LABEL_BONUS, cost)
    pairs = _in_turn(cost, confirmed)
    which, detection = np.array([p[0] for p in pairs], np.intp), np.array([p[1] for p in pairs], np.intp)
    return Pairing(which, detection, odds[which, detection])


def _distances(expected: Expected, rays: Rays) -> tuple[Array, Array]:
    """(N, K) squared Mahalanobis distances, and determinants of what they are measured by."""
    S, drift = expected.covariance, expected.drift[:, None] * rays.after_s[None, :, None]
    x, y = np.moveaxis(rays.pixels[None] - expected.sighting.pixels[:, None] - drift, 2, 0)
    noise = rays.sigma_px[None] ** 2
    a, b, d = S[:, 0, 0][:, None] + noise, S[:, 0, 1][:, None], S[:, 1, 1][:, None] + noise
    determinant = a * d - b * b
    return (d * x * x - 2 * b * x * y + a * y * y) / determinant, determinant


def _in_turn(cost: Array, confirmed: NDArray[np.bool_]) -> list[tuple[int, int]]:
    if confirmed.all() or not confirmed.any():
        return assign(cost, 0.0)
    first = assign(np.where(confirmed[:, None], cost, 0.0), 0.0)
    cost[:, [k for _, k in first]] = 0.0
    return first + assign(np.where(confirmed[:, None], 0.0, cost), 0.0)


def assign(cost: Array, limit: float | Array = GATE) -> list[tuple[int, int]]:
    """Pairs (row, column) of least total cost, each below limit. cost: (N, M); limit: a number, or (N, 1) per row.

    Crouse (2016), by scipy. Leaving a row alone costs it its limit, so a far pairing never pushes out a near one.
    """
    gain = cost - limit
    near = gain < 0
    if not near.any():
        return []
    if near.sum(axis=0).max() <= 1 and near.sum(axis=1).max() <= 1:
        return list(zip(*(index.tolist() for index in np.nonzero(near)), strict=True))
    rows, columns = linear_sum_assignment(np.where(near, gain, 0.0))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if near[r, c]]
