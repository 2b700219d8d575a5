"""The motion that lays an estimate onto the truth, for many candidate pairings at once.

The hazard is an alignment that swallows the error it should show: every degree of freedom given away hides some. So the
kinds are named after what they hide, in rising order, and each report says which one was used.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from edge.common.arrays import Array

Alignment = Literal["none", "shift", "yaw", "se3", "sim3"]
ALIGNMENTS: Final[tuple[Alignment, ...]] = ("none", "shift", "yaw", "se3", "sim3")


@dataclass(frozen=True)
class Motions:
    """S similarities: truth = scale R estimate + shift. R: (S, 3, 3), scale: (S,), shift_m: (S, 3)."""

    R_truth_estimate: Array
    scale: Array
    shift_m: Array

    def apply(self, points: Array) -> Array:
        """(S, N, 3) of points (S, N, 3)."""
        turned = points @ np.swapaxes(self.R_truth_estimate, 1, 2)
        moved: Array = turned * self.scale[:, None, None] + self.shift_m[:, None, :]
        return moved


def fit(alignment: Alignment, estimate: Array, truth: Array, valid: Array) -> Motions:
    """Least-squares motions (Umeyama 1991) of S pairings. estimate, truth: (S, N, 3); valid: (S, N), 0 or 1."""
    count = len(estimate)
    R, scale = np.tile(np.eye(3), (count, 1, 1)), np.ones(count)
    if alignment == "none":
        return Motions(R, scale, np.zeros((count, 3)))
    weight = valid / np.maximum(valid.sum(axis=1, keepdims=True), 1)
    mean_e, mean_t = (np.einsum("sn,sni->si", weight, points) for points in (estimate, truth))
    e, t = estimate - mean_e[:, None], truth - mean_t[:, None]
    cross = np.einsum("sn,sni,snj->sij", weight, t, e, optimize=True)
    if alignment == "yaw":
        R = _about_up(np.arctan2(cross[:, 1, 0] - cross[:, 0, 1], cross[:, 0, 0] + cross[:, 1, 1]))
    elif alignment in {"se3", "sim3"}:
        R, along = _rotations(cross)
        if alignment == "sim3":
            scale = along / np.maximum(np.einsum("sn,sni,sni->s", weight, e, e, optimize=True), 1e-12)
    shift = mean_t - scale[:, None] * np.einsum("sij,sj->si", R, mean_e)
    return Motions(R, scale, shift)


def _about_up(angle_rad: Array) -> Array:
    """(S, 3, 3) rotations about the up axis."""
    R = np.tile(np.eye(3), (len(angle_rad), 1, 1))
    R[:, 0, 0] = R[:, 1, 1] = np.cos(angle_rad)
    R[:, 1, 0] = np.sin(angle_rad)
    R[:, 0, 1] = -R[:, 1, 0]
    return R


def _rotations(cross: Array) -> tuple[Array, Array]:
    """Proper rotations (S, 3, 3) nearest to cross covariances, and the covariance (S,) along them."""
    U, singular, Vt = np.linalg.svd(cross)
    sign = np.ones((len(cross), 3))
    sign[:, 2] = np.sign(np.linalg.det(U @ Vt))
    return np.asarray((U * sign[:, None, :]) @ Vt), np.asarray((singular * sign).sum(axis=1))
