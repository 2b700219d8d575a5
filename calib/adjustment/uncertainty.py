"""How certain a settled adjustment is of what it found: its cameras, and anything on the flight that they carry.

The hazard is to take the flight's own covariance for the whole: the cameras' errors move every position together, and
do not average away.
"""

import numpy as np

from calib.adjustment.bundle import Adjusted, Problem
from calib.adjustment.normal import local_covariance
from calib.adjustment.projection import Projected, unknowns_of
from calib.geometry.spline import ORDER, Located
from edge.common.arrays import Array


def camera_covariance(adjusted: Adjusted, problem: Problem) -> Array:
    """(14 C, 14 C) covariance of all cameras' unknowns; zero for those held fixed."""
    free = np.concatenate([np.where(prior.fixed, 0.0, 1.0) for prior in problem.priors])
    covariance: Array = adjusted.factor.camera_covariance * free[:, None] * free
    return covariance


def position_covariance(adjusted: Adjusted, problem: Problem, located: Located) -> Array:
    """(N, 3, 3) covariance of positions on the flight: the flight's own and, through it, the cameras'."""
    w, four = located.weights(), located.controls()
    own = local_covariance(adjusted.normal.block)[located.first]
    covariance = np.einsum("ni,niajb,nj->nab", w, own, w, optimize=True)
    cameras = camera_covariance(adjusted, problem)
    carried = adjusted.factor.carried.reshape(-1, 3, len(cameras))
    moved = sum(w[:, i, None, None] * carried[four[:, i]] for i in range(ORDER))
    total: Array = covariance + (moved @ cameras) @ np.transpose(moved, (0, 2, 1))
    return total


def prediction_px2(adjusted: Adjusted, problem: Problem, index: int, image: Projected) -> Array:
    """(N,) variance of a pixel coordinate predicted for rows that took no part, without the row's own noise.

    image: of those rows, by the camera of that index. The flight's share and the cameras', both of them correlated.
    """
    w, four = image.located.weights(), image.located.controls()
    cameras = camera_covariance(adjusted, problem)
    local = local_covariance(adjusted.normal.block)[image.located.first]
    flight = np.einsum("ni,niajb,nj->nab", w, local, w, optimize=True)
    carried = adjusted.factor.carried.reshape(-1, 3, len(cameras))
    by_all = -image.by_point @ sum(w[:, i, None, None] * carried[four[:, i]] for i in range(ORDER))
    by_all[:, :, unknowns_of(index)] += image.by_camera
    total = np.einsum("nia,nab,nib->n", image.by_point, flight, image.by_point, optimize=True)
    total += np.einsum("nik,nik->n", by_all @ cameras, by_all)
    mean: Array = total / 2
    return mean
