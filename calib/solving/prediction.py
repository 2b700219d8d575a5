"""How uncertain a position will be before anything flies there: from the network alone, or from a plan of one.

The hazard is to count the pixels' noise only, or to count too much. Errors of poses and lenses are the same for all
rows, do not average away and grow with the distance; but an attitude and a principal point err together and cancel
where the flight was, so both must be in. Near the line through two cameras, two rays hardly cross. The answer is for a
single instant without any smoothing: a filter does better.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.adjustment.projection import CAMERA_SIZE, LENS, POSE, unknowns_of
from calib.network import Camera
from calib.sighting import CameraView, by_lens, sight
from edge.common.arrays import Array

DIRECTIONS: Final = 1200  # over the whole sphere, for drones fly below cameras on roofs: six degrees apart


@dataclass(frozen=True)
class PredictedAccuracy:
    """At points (N, 3): cameras (N,) int64 that see each; and, NaN where fewer than two do, one-sigma covariances.

    pixels_m2: (N, 3, 3) from the pixels' noise; network_m2: (N, 3, 3) from poses and lenses of all cameras together.
    camera_m2: (N, C) trace of what each camera's own add, the others' taken as known.
    """

    cameras: np.ndarray
    pixels_m2: Array
    network_m2: Array
    camera_m2: Array

    @property
    def sigma_m(self) -> Array:
        """(N,) root of the trace: what an RMSE against truth would be."""
        total: Array = np.sqrt(np.trace(self.pixels_m2 + self.network_m2, axis1=1, axis2=2))
        return total


def predict(cameras: tuple[Camera, ...], sigma_px: Array, covariance: Array, points_enu: Array) -> PredictedAccuracy:
    """Predict at points (N, 3) ENU, at rest. sigma_px: (C,) a coordinate.

    covariance: (14 C, 14 C) of all unknowns in the order of projection.py; zeros where something is taken as known.
    """
    n, c = len(points_enu), len(cameras)
    information, coupling = np.zeros((n, 3, 3)), np.zeros((n, 3, CAMERA_SIZE * c))
    seeing = np.zeros(n, np.int64)
    for index, camera in enumerate(cameras):
        view = CameraView.of(camera)
        image, bent = sight(camera, points_enu, view.widest_ray)
        seen = image.valid & view.inside(image.pixels)
        weight = seen / sigma_px[index] ** 2
        transposed = image.by_point.transpose(0, 2, 1) * weight[:, None, None]
        information += transposed @ image.by_point
        by_camera = np.zeros((n, 2, CAMERA_SIZE))  # clock and readout move nothing that rests
        by_camera[:, :, POSE], by_camera[:, :, LENS] = image.by_pose, by_lens(camera, bent)
        coupling[:, :, unknowns_of(index)] = transposed @ by_camera
        seeing += seen
    known = seeing >= 2
    pixels = np.full((n, 3, 3), np.nan)
    pixels[known] = np.linalg.inv(information[known])
    by_all = -pixels @ coupling
    network = by_all @ covariance @ by_all.transpose(0, 2, 1)
    return PredictedAccuracy(seeing, pixels, network, _shares(by_all, covariance, c))


def _shares(by_all: Array, covariance: Array, cameras: int) -> Array:
    columns = []
    for index in range(cameras):
        at = unknowns_of(index)
        own = by_all[:, :, at]
        columns.append(np.einsum("nij,jk,nik->n", own, covariance[at, at], own, optimize=True))
    return np.stack(columns, axis=1)


def directions(count: int = DIRECTIONS) -> Array:
    """(count, 3) unit vectors spread evenly, as a Fibonacci spiral does (Vogel 1979)."""
    i = np.arange(count) + 0.5
    up = 1 - 2 * i / count
    azimuth = np.pi * (3 - np.sqrt(5)) * i
    flat = np.sqrt(1 - up**2)
    return np.column_stack([flat * np.sin(azimuth), flat * np.cos(azimuth), up])


def middle(cameras: tuple[Camera, ...]) -> Array:
    """(3,) mean of the cameras' centres, ENU metres: what distances are from."""
    centre: Array = np.mean([camera.centre_enu for camera in cameras], axis=0)
    return centre
