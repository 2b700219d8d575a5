"""Similarity between two frames: scale, rotation and shift from points known in both (Kabsch 1976, Umeyama 1991).

The hazards: a reflection that fits better than any rotation, and points in a line that leave the roll about it open.
The determinant is therefore forced to +1, and the weakest singular value is reported.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.errors import CalibrationError
from edge.common.arrays import Array

HOLD_A_FRAME: Final = 3  # points, not in a line: with fewer the roll about their line is free
UP_WEIGHT: Final = 1e-2  # a survey knows the line's direction to a milliradian, a level knows up to a degree


@dataclass(frozen=True)
class Similarity:
    """target = scale * rotation @ source + shift. rotation: (3, 3), det +1; shift: (3,)."""

    scale: float
    rotation: Array
    shift: Array

    def __post_init__(self) -> None:
        if not self.scale > 0 or np.linalg.det(self.rotation) < 0:
            raise CalibrationError("not a similarity", where="similarity", action="give scale > 0 and a rotation")

    def apply(self, points: Array) -> Array:
        """(N, 3) points of the source frame, in the target frame."""
        moved: Array = self.scale * points @ self.rotation.T + self.shift
        return moved


UNCHANGED: Final = Similarity(1.0, np.eye(3), np.zeros(3))  # of points already in the frame they are wanted in


def about(point: Array, turn: Array) -> Similarity:
    """A rotation (3, 3) of the world that leaves a point (3,) where it is."""
    return Similarity(1.0, turn, point - turn @ point)


@dataclass(frozen=True)
class SimilarityFit:
    """A fitted similarity, its misfit (N, 3) and flatness: second over first singular value of the points."""

    similarity: Similarity
    residual: Array
    flatness: float


def fit_similarity(source: Array, target: Array, weight: Array | None = None, *, scaled: bool = True) -> SimilarityFit:
    """The similarity (a rigid motion if not `scaled`) that takes (N, 3) source points closest to (N, 3) target points.

    weight: (N,), one by default. Raises CalibrationError for fewer than three points or points at one place.
    Umeyama 1991, weighted.
    """
    if len(source) < HOLD_A_FRAME:
        raise CalibrationError(
            f"{len(source)} common points, a similarity needs three",
            where="georeferencing",
            action="survey the position of at least three cameras",
        )
    w = np.ones(len(source)) if weight is None else weight
    w = (w / w.sum())[:, None]
    source_mean, target_mean = (w * source).sum(0), (w * target).sum(0)
    a, b = source - source_mean, target - target_mean
    U, D, Vt = np.linalg.svd((w * b).T @ a)
    spread = float((w * a * a).sum())
    if not spread > 0:
        raise CalibrationError("all points are at one place", where="georeferencing", action="check the positions")
    S = np.diag([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt)) or 1.0])
    rotation = U @ S @ Vt
    scale = float(np.trace(np.diag(D) @ S) / spread) if scaled else 1.0
    similarity = Similarity(max(scale, np.finfo(float).tiny), rotation, target_mean - scale * rotation @ source_mean)
    singular = np.linalg.svd(a, compute_uv=False)
    return SimilarityFit(similarity, target - similarity.apply(source), float(singular[1] / singular[0]))


def fit_with_up(source: Array, target: Array, up_source: Array) -> Similarity:
    """The similarity of points in a line, or two, the roll about it told by where up is.

    source, target: (N, 3), N >= 2. up_source: (U, 3) unit vectors that point up in the source frame; up in the target
    is (0, 0, 1). Raises CalibrationError if the points are at one place. Wahba's problem, by SVD (Markley 1988).
    """
    a, b = source - source.mean(0), target - target.mean(0)
    spread_a, spread_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if not spread_a > 0 or not spread_b > 0:
        raise CalibrationError("all points are at one place", where="georeferencing", action="check the positions")
    up = np.tile([0.0, 0.0, 1.0], (len(up_source), 1))
    U, _, Vt = np.linalg.svd((b / spread_b).T @ (a / spread_a) + UP_WEIGHT * up.T @ up_source)
    rotation = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt)) or 1.0]) @ Vt
    scale = spread_b / spread_a
    return Similarity(scale, rotation, target.mean(0) - scale * rotation @ source.mean(0))


def rms(residual: Array) -> float:
    """Root mean square length of (N, 3) residuals, metres."""
    return float(np.sqrt((residual**2).sum(1).mean()))
