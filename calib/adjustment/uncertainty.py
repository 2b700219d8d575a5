"""How certain a settled adjustment is of what it found: its cameras, and anything on the flight that they carry.

The hazard is to take the flight's own covariance for the whole: the cameras' errors move every position together, and
do not average away. Another is the tangent: what pixels determine is the inverse of a distance, and a distance known to
a fifth of itself may as well be infinite; its covariance, a straight line at the estimate, says it is not.
"""

from typing import Final

import numpy as np

from calib.adjustment.bundle import Adjusted
from calib.adjustment.problem import Problem
from calib.adjustment.projection import Projected, unknowns_of
from calib.geometry.spline import ORDER, Located
from edge.common.arrays import Array

SURE_SIGMAS: Final = 4.0  # to which a stated sigma has to hold
WIDEST: Final = 20.0  # times the tangent's sigma: the distance is open, and refused as such


def camera_covariance(adjusted: Adjusted, problem: Problem) -> Array:
    """(14 C, 14 C) covariance of all cameras' unknowns; zero for those held fixed.

    Where priors are off by more than they were weighed by (Q beyond P^-1), the estimate is off by C P Q P C more.
    """
    covariance = settled_covariance(adjusted, problem)
    if problem.beyond is None:
        return covariance
    pull = covariance @ problem.prior.information
    return covariance + pull @ problem.beyond @ pull.T


def settled_covariance(adjusted: Adjusted, problem: Problem) -> Array:
    """(14 C, 14 C) the same if the priors are as good as they were weighed."""
    free = np.concatenate([np.where(prior.fixed, 0.0, 1.0) for prior in problem.priors])
    covariance: Array = adjusted.factor.camera_covariance * free[:, None] * free
    return covariance


def position_covariance(adjusted: Adjusted, problem: Problem, located: Located) -> Array:
    """(N, 3, 3) covariance of positions on the flight: the flight's own and, through it, the cameras'."""
    return positions_by(camera_covariance(adjusted, problem), adjusted, located)


def positions_by(cameras: Array, adjusted: Adjusted, located: Located) -> Array:
    """(N, 3, 3) the same, if (14 C, 14 C) were the covariance of all cameras' unknowns."""
    w, four = located.weights(), located.controls()
    own = adjusted.flight_covariance[located.first]
    covariance = np.einsum("ni,niajb,nj->nab", w, own, w, optimize=True)
    carried = adjusted.factor.carried.reshape(-1, 3, len(cameras))
    moved = sum(w[:, i, None, None] * carried[four[:, i]] for i in range(ORDER))
    total: Array = covariance + (moved @ cameras) @ np.transpose(moved, (0, 2, 1))
    return total


def curved(covariance: Array, points: Array, middle: Array) -> Array:
    """Covariance (N, 3, 3) of points (N, 3), as wide along the line of sight as the inverse of the distance allows.

    middle: (3,) of the cameras. With s one sigma of the distance as a share of it, the inverse distance at SURE_SIGMAS
    is 1 - SURE_SIGMAS s of what it is, and the distance beyond by so much; infinite where that is nothing. What lacks
    is added and nothing is turned: a least certain direction that is not the line of sight stays as uncertain.
    """
    sight = points - middle
    distance = np.linalg.norm(sight, axis=1)
    sight = sight / distance[:, None]
    variance = np.einsum("ni,nij,nj->n", sight, covariance, sight)
    times = 1 / np.maximum(1 - SURE_SIGMAS * np.sqrt(variance) / distance, 1 / WIDEST)
    total: Array = covariance + ((times**2 - 1) * variance)[:, None, None] * sight[:, :, None] * sight[:, None, :]
    return total


def prediction_px2(adjusted: Adjusted, problem: Problem, index: int, image: Projected) -> Array:
    """(N,) variance of a pixel coordinate predicted for rows that took no part, without the row's own noise.

    image: of those rows, by the camera of that index. The flight's share and the cameras', both of them correlated.
    """
    w, four = image.located.weights(), image.located.controls()
    cameras = camera_covariance(adjusted, problem)
    local = adjusted.flight_covariance[image.located.first]
    flight = np.einsum("ni,niajb,nj->nab", w, local, w, optimize=True)
    carried = adjusted.factor.carried.reshape(-1, 3, len(cameras))
    by_all = -image.by_point @ sum(w[:, i, None, None] * carried[four[:, i]] for i in range(ORDER))
    by_all[:, :, unknowns_of(index)] += image.by_camera
    total = np.einsum("nia,nab,nib->n", image.by_point, flight, image.by_point, optimize=True)
    total += np.einsum("nik,nik->n", by_all @ cameras, by_all)
    mean: Array = total / 2
    return mean
