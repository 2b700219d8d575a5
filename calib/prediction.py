"""How uncertain a position will be before anything flies there: from the network alone, or from a plan of one.

The hazard is to count the pixels' noise only. Errors of the cameras' poses are the same for all rows, do not average
away and grow with the distance; near the line through two cameras, two rays hardly cross. Both are in the answer, for a
single instant without any smoothing: a filter does better, never worse.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.network import POSE_SIZE, Camera
from calib.sighting import View
from edge.lens import Array

SKY_POINTS: Final = 600  # directions over the hemisphere: about six degrees apart
LOWEST_ELEVATION_DEG: Final = 3.0  # below it hills and houses are in the way


@dataclass(frozen=True)
class Prediction:
    """At points (N, 3): cameras (N,) int64 that see each; and, NaN where fewer than two do, one-sigma covariances.

    pixels_m2: (N, 3, 3) from the pixels' noise; poses_m2: (N, 3, 3) from the cameras' poses together.
    camera_m2: (N, C) trace of what each camera's own pose adds, the others' taken as known.
    """

    cameras: np.ndarray
    pixels_m2: Array
    poses_m2: Array
    camera_m2: Array

    @property
    def sigma_m(self) -> Array:
        """(N,) root of the trace: what an RMSE against truth would be."""
        total: Array = np.sqrt(np.trace(self.pixels_m2 + self.poses_m2, axis1=1, axis2=2))
        return total


def predict(cameras: tuple[Camera, ...], sigma_px: Array, pose_covariance: Array, points_enu: Array) -> Prediction:
    """Predict at points (N, 3) ENU. sigma_px: (C,) a coordinate; pose_covariance: (6 C, 6 C) as in Network."""
    n, c = len(points_enu), len(cameras)
    information, coupling = np.zeros((n, 3, 3)), np.zeros((n, 3, POSE_SIZE * c))
    seeing = np.zeros(n, np.int64)
    for index, camera in enumerate(cameras):
        view = View.of(camera)
        image = view.sight(points_enu)
        seen = image.valid & view.inside(image.pixels)
        weight = seen / sigma_px[index] ** 2
        transposed = image.by_point.transpose(0, 2, 1) * weight[:, None, None]
        information += transposed @ image.by_point
        coupling[:, :, POSE_SIZE * index : POSE_SIZE * (index + 1)] = transposed @ image.by_pose
        seeing += seen
    known = seeing >= 2
    pixels = np.full((n, 3, 3), np.nan)
    pixels[known] = np.linalg.inv(information[known])
    by_pose = -pixels @ coupling
    poses = by_pose @ pose_covariance @ by_pose.transpose(0, 2, 1)
    return Prediction(seeing, pixels, poses, _by_camera(by_pose, pose_covariance, c))


def _by_camera(by_pose: Array, covariance: Array, cameras: int) -> Array:
    columns = []
    for index in range(cameras):
        at = slice(POSE_SIZE * index, POSE_SIZE * (index + 1))
        own = by_pose[:, :, at]
        columns.append(np.einsum("nij,jk,nik->n", own, covariance[at, at], own, optimize=True))
    return np.stack(columns, axis=1)


def sky_directions(count: int = SKY_POINTS) -> Array:
    """(count, 3) unit vectors spread evenly over the sky, as a Fibonacci spiral does (Vogel 1979)."""
    i = np.arange(count) + 0.5
    lowest = np.sin(np.radians(LOWEST_ELEVATION_DEG))
    up = lowest + (1 - lowest) * i / count
    azimuth = np.pi * (3 - np.sqrt(5)) * i
    flat = np.sqrt(1 - up**2)
    return np.column_stack([flat * np.sin(azimuth), flat * np.cos(azimuth), up])


def middle(cameras: tuple[Camera, ...]) -> Array:
    """(3,) mean of the cameras' centres, ENU metres: what distances are from."""
    centre: Array = np.mean([camera.centre_enu for camera in cameras], axis=0)
    return centre
