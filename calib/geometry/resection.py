"""One camera against known points: its pose by EPnP (Lepetit, Moreno-Noguer and Fua 2009) inside RANSAC.

The hazard is a camera that does not belong: a clock half a second off, a lens file of another camera, a detector full
of clutter. It must not be averaged in. So the share of points it explains is the result as much as the pose is, and
the caller decides. OpenCV draws its samples from a generator that is seeded here: the same input gives the same pose.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

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


def resect(points: Array, rays: Array, threshold_ray: float) -> Resection | None:
    """Pose of a camera from (N, 3) points and (N, 2) rays; None if six do not agree within threshold_ray."""
    if len(points) < FEWEST_POINTS:
        return None
    # EPnP's conditioning suffers from a world origin far from the points.
    middle, size = points.mean(0), max(float(points.std()), 1e-9)
    scaled = np.ascontiguousarray((points - middle) / size)
    cv2.setRNGSeed(SEED)
    ok, rotation, t, inlier = cv2.solvePnPRansac(
        scaled, np.ascontiguousarray(rays), np.eye(3), None,
        iterationsCount=FOUR_POINT_DRAWS, reprojectionError=threshold_ray, confidence=0.999, flags=cv2.SOLVEPNP_EPNP,
    )  # fmt: skip
    if not ok or inlier is None or len(inlier) < FEWEST_POINTS:
        return None
    chosen = inlier.ravel()
    rotation, t = cv2.solvePnPRefineLM(scaled[chosen], rays[chosen], np.eye(3), None, rotation, t)
    R = cv2.Rodrigues(rotation)[0]
    centre = middle - size * (R.T @ t.ravel())
    in_camera = (points - centre) @ R.T
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.linalg.norm(in_camera[:, :2] / in_camera[:, 2:] - rays, axis=1)
    good = (off < threshold_ray) & (in_camera[:, 2] > 0)
    if good.sum() < FEWEST_POINTS:
        return None
    return Resection(R, centre, good, float(np.sqrt(np.mean(off[good] ** 2))))
