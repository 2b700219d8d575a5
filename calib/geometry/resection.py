"""One camera against known points: its pose by EPnP (Lepetit, Moreno-Noguer and Fua 2009) inside RANSAC.

The hazard is a camera that does not belong: a clock half a second off, a lens file of another camera, a detector full
of clutter. It must not be averaged in. So the share of points it explains is the result as much as the pose is, and
the caller decides. OpenCV draws its samples from a generator that is seeded here: the same input gives the same pose.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.geometry.combinations import COMBINATION_DRAWS, of_one_combination
from edge.common.arrays import Array

FOUR_POINT_DRAWS = 300  # four points at 50 % outliers need 72 for 99 %
FEWEST_POINTS = 6
SEED = 1


@dataclass(frozen=True)
class Resection:
    """A camera's pose against world points: R (3, 3) world to camera, centre (3,), inlier (N,), rms_ray of those."""

    R: Array
    centre: Array
    inlier: NDArray[np.bool_]
    rms_ray: float

    @property
    def share(self) -> float:
        """Share of the points that the pose explains."""
        return float(np.mean(self.inlier))


def resect(
    points: Array, rays: Array, threshold_ray: float, combination: NDArray[np.int64] | None = None
) -> Resection | None:
    """Pose of a camera from (N, 3) points and (N, 2) rays; None if six do not agree within threshold_ray.

    combination: (N,) rows that are right or wrong together, a track taken for an object; None where there is but one.
    """
    if len(points) < FEWEST_POINTS:
        return None
    # EPnP's conditioning suffers from a world origin far from the points.
    middle, size = points.mean(0), max(float(points.std()), 1e-9)
    scaled = np.ascontiguousarray((points - middle) / size)
    rays = np.ascontiguousarray(rays)
    best: _Drawn | None = None
    for rows in (np.arange(len(points)), *of_one_combination(combination)):
        found = _drawn(scaled, rays, rows, threshold_ray)
        if found and (best is None or len(found.inlier) > len(best.inlier)):
            best = found
    if best is None:
        return None
    chosen = best.inlier
    rotation, t = cv2.solvePnPRefineLM(scaled[chosen], rays[chosen], np.eye(3), None, best.rotation, best.t)
    R = cv2.Rodrigues(rotation)[0]
    off = _off(scaled, rays, R, t)
    good = off < threshold_ray
    if good.sum() < FEWEST_POINTS:
        return None
    return Resection(R, middle - size * (R.T @ t.ravel()), good, float(np.sqrt(np.mean(off[good] ** 2))))


@dataclass(frozen=True)
class _Drawn:
    """A pose as OpenCV has it, and the rows that it explains, (K,)."""

    rotation: Array
    t: Array
    inlier: NDArray[np.int64]


def _drawn(points: Array, rays: Array, rows: NDArray[np.int64], threshold_ray: float) -> _Drawn | None:
    """The pose that most of these rows agree with."""
    if len(rows) < FEWEST_POINTS:
        return None
    whole = len(rows) == len(points)
    cv2.setRNGSeed(SEED)
    ok, rotation, t, inlier = cv2.solvePnPRansac(
        points[rows], rays[rows], np.eye(3), None,
        iterationsCount=FOUR_POINT_DRAWS if whole else COMBINATION_DRAWS, reprojectionError=threshold_ray,
        confidence=0.999, flags=cv2.SOLVEPNP_EPNP,
    )  # fmt: skip
    if not ok or inlier is None:
        return None
    explained = inlier.ravel()
    if not whole:
        explained = np.flatnonzero(_off(points, rays, cv2.Rodrigues(rotation)[0], t) < threshold_ray)
    return _Drawn(rotation, t, explained) if len(explained) >= FEWEST_POINTS else None


def _off(points: Array, rays: Array, R: Array, t: Array) -> Array:
    """(N,) how far in ray units each point appears from its ray; infinite behind the camera."""
    in_camera = points @ R.T + t.ravel()
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.linalg.norm(in_camera[:, :2] / in_camera[:, 2:] - rays, axis=1)
    return np.where(in_camera[:, 2] > 0, off, np.inf)
