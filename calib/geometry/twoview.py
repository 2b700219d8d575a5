"""Two cameras: their relative pose from the rays to one moving object, and points from two or more poses.

The hazards. A nearly planar flight has a twin: a second essential matrix about 140 degrees away that fits as well, and
neither the singular values nor the count of points in front of both cameras shows it. And each pair has a scale of its
own. So these functions return every candidate with its score and decide nothing: a third camera does (bootstrap.py).
Rays are undistorted normalised coordinates (x, y) with z = 1; the first camera is the origin.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.geometry.combinations import COMBINATION_DRAWS, of_one_combination
from edge.common.arrays import Array

RANSAC_CONFIDENCE = 0.9999
# Five-point RANSAC at 40 % outliers wants 90 draws for that confidence; noise wastes most of them.
FIVE_POINT_DRAWS = 1000
FEWEST_LINEAR = 8  # rows of the linear solution
BEST_COMBINATIONS = 3  # of which poses are made: a twin or two beside the right one


@dataclass(frozen=True)
class RelativePose:
    """The second camera seen from the first: x2 = R x1 + t with |t| = 1. inlier: (N,) of the rays it was found from."""

    R: Array
    t: Array
    inlier: NDArray[np.bool_]


def essential_by_svd(rays1: Array, rays2: Array) -> Array:
    """(3, 3) essential matrix of (N, 2) rays, N >= 8, by SVD (Longuet-Higgins 1981, normalised as Hartley 1997).

    The two equal singular values are forced: the nearest essential matrix in the Frobenius norm.
    """
    (x1, T1), (x2, T2) = _normalised(rays1), _normalised(rays2)
    A = (x2[:, :, None] * x1[:, None, :]).reshape(-1, 9)
    E = T2.T @ np.linalg.svd(A)[2][-1].reshape(3, 3) @ T1
    U, _, Vt = np.linalg.svd(E)
    return np.asarray(U @ np.diag([1.0, 1.0, 0.0]) @ Vt)


def _normalised(rays: Array) -> tuple[Array, Array]:
    centre = rays.mean(0)
    scale = np.sqrt(2) / max(float(np.linalg.norm(rays - centre, axis=1).mean()), 1e-12)
    T = np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])
    return np.column_stack([rays, np.ones(len(rays))]) @ T.T, T


def essential_robust(
    rays1: Array, rays2: Array, threshold_ray: float, draws: int = FIVE_POINT_DRAWS
) -> tuple[list[Array], NDArray[np.bool_]]:
    """Essential matrices of (N, 2) rays and their inliers (N,), five points at a time (Nister 2004) in RANSAC.

    Deterministic: OpenCV's classic RANSAC seeds itself. An empty list if there is none.
    """
    if len(rays1) < 6:
        return [], np.zeros(len(rays1), bool)
    E, mask = cv2.findEssentialMat(
        np.ascontiguousarray(rays1), np.ascontiguousarray(rays2), np.eye(3), cv2.RANSAC,
        RANSAC_CONFIDENCE, threshold_ray, draws,
    )  # fmt: skip
    if E is None or E.shape[1] != 3:
        return [], np.zeros(len(rays1), bool)
    return [E[i : i + 3] for i in range(0, len(E), 3)], mask.ravel().astype(bool)


def decompose(E: Array) -> list[tuple[Array, Array]]:
    """The four (R, t) of an essential matrix, by SVD (Hartley and Zisserman, section 9.6.2)."""
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.linalg.det(U), Vt * np.linalg.det(Vt)
    W = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    t = U[:, 2]
    return [(U @ rotation @ Vt, sign * t) for rotation in (W, W.T) for sign in (1, -1)]


def triangulate(rays: list[Array], rotations: list[Array], centres: list[Array]) -> Array:
    """Points (N, 3) from (N, 2) rays in each of C >= 2 cameras, linear, by SVD (Hartley and Sturm 1997).

    rotations: world to camera (3, 3); centres: (3,) in the world. A ray that is NaN is left out of its point.
    """
    rows = []
    for ray, R, centre in zip(rays, rotations, centres, strict=True):
        P = np.column_stack([R, -R @ centre])
        pair = ray[:, :, None] * P[2] - P[:2]
        # A ray of unit length weighs the same whether it is seen at the centre or at the edge.
        rows.append(np.nan_to_num(pair / np.sqrt(1 + (ray**2).sum(1))[:, None, None]))
    homogeneous = np.linalg.svd(np.concatenate(rows, axis=1))[2][:, -1]
    points: Array = homogeneous[:, :3] / homogeneous[:, 3:]
    return points


def reprojection(points: Array, rays: Array, R: Array, centre: Array) -> Array:
    """(N,) distances in ray units between where points appear and rays (N, 2); infinite behind the camera."""
    in_camera = (points - centre) @ R.T
    front = in_camera[:, 2] > 0
    safe = np.where(front, in_camera[:, 2], 1.0)
    return np.where(front, np.linalg.norm(in_camera[:, :2] / safe[:, None] - rays, axis=1), np.inf)


def relative_poses(
    rays1: Array, rays2: Array, threshold_ray: float, combination: NDArray[np.int64] | None = None
) -> list[RelativePose]:
    """Every relative pose worth trying, best supported first: most points in front of both cameras and near both rays.

    rays1, rays2: (N, 2) at common times; combination: (N,) rows that are right or wrong together, or None.
    Poses that under half as many points support as the best are dropped.
    """
    essentials, inlier = essential_robust(rays1, rays2, threshold_ray)
    if inlier.sum() >= FEWEST_LINEAR:
        essentials.append(essential_by_svd(rays1[inlier], rays2[inlier]))
    essentials += _by_combination(rays1, rays2, threshold_ray, combination)
    poses = []
    for E in essentials:
        for R, t in decompose(E):
            centre = -R.T @ t
            points = triangulate([rays1, rays2], [np.eye(3), R], [np.zeros(3), centre])
            far = np.maximum(
                reprojection(points, rays1, np.eye(3), np.zeros(3)), reprojection(points, rays2, R, centre)
            )
            poses.append(RelativePose(R, t, far < threshold_ray))
    poses.sort(key=lambda pose: -int(pose.inlier.sum()))
    best = poses[0].inlier.sum() if poses else 0
    return [pose for pose in poses if pose.inlier.sum() * 2 > best and pose.inlier.sum() >= FEWEST_LINEAR]


def _by_combination(
    rays1: Array, rays2: Array, threshold_ray: float, combination: NDArray[np.int64] | None
) -> list[Array]:
    """Essential matrices of one combination's rows each, those that most of all rows bear out."""
    found = []
    for rows in of_one_combination(combination):
        for E in essential_robust(rays1[rows], rays2[rows], threshold_ray, COMBINATION_DRAWS)[0]:
            found.append((E, _epipolar_distance(E, rays1, rays2) < threshold_ray))
    found.sort(key=lambda entry: -int(entry[1].sum()))
    best = [entry for entry in found[:BEST_COMBINATIONS] if entry[1].sum() >= FEWEST_LINEAR]
    return [E for E, _ in best] + [essential_by_svd(rays1[near], rays2[near]) for _, near in best]


def _epipolar_distance(E: Array, rays1: Array, rays2: Array) -> Array:
    """(N,) distance in ray units from the nearest pair of rays that meet, to first order (Sampson 1982)."""
    x1, x2 = (np.column_stack([rays, np.ones(len(rays))]) for rays in (rays1, rays2))
    line2, line1 = x1 @ E.T, x2 @ E
    steep = np.sqrt((line1[:, :2] ** 2).sum(1) + (line2[:, :2] ** 2).sum(1))
    distance: Array = np.abs((x2 * line2).sum(1)) / np.maximum(steep, np.finfo(float).tiny)
    return distance
