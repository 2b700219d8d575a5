"""From the flight to the pixel, with the derivative by everything that is unknown in between.

Observation k of camera c is the pixel at stamped time t; the object was then at
X(t + offset + rate (t - t_mid) + readout v / H). The derivatives are analytic: a numerical one costs 26 projections an
observation and is only good to half the digits, which the last steps of an adjustment without noise can tell.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.geometry.spline import Flight, Located, evaluate, velocity
from calib.network import Camera
from edge.common.arrays import Array
from edge.lens import distort

# The unknowns of one camera, in the order of every Jacobian's columns.
ROTATION: Final = slice(0, 3)  # rad, camera frame: R = exp(rotation) R_cam_enu
CENTRE: Final = slice(3, 6)  # m, ENU
OFFSET: Final = 6  # s
RATE: Final = 7  # s/s
READOUT: Final = 8  # s
LENS: Final = slice(9, 14)  # fx, fy, cx, cy (px), the distortion's refined coefficient
CAMERA_SIZE: Final = 14

# A point this near (or behind) has no image; its residual is set aside rather than let to explode.
NEAREST_DEPTH: Final = 1e-6


@dataclass(frozen=True)
class CameraData:
    """One camera's observations, ready to adjust. t_s: (N,) stamps in seconds from t_mid; pixels: (N, 2);
    target: (N,) the object each is of; sigma_px: (N,) relative one-sigma as the detector says, 1 if it says nothing.
    """

    t_s: Array
    pixels: Array
    target: NDArray[np.int64]
    sigma_px: Array

    def rows(self, which: slice | NDArray[np.bool_]) -> "CameraData":
        """Only some of the rows."""
        return CameraData(self.t_s[which], self.pixels[which], self.target[which], self.sigma_px[which])


@dataclass(frozen=True)
class Projected:
    """Residuals of one camera and their derivatives.

    residual: (N, 2) px, predicted minus seen. by_point: (N, 2, 3) by the object's position. by_camera: (N, 2, 14).
    located: where the observations fall on the spline. valid: (N,) in front of the camera and within a stretch.
    """

    residual: Array
    by_point: Array
    by_camera: Array
    located: Located
    valid: NDArray[np.bool_]


def site_time_s(camera: Camera, data: CameraData) -> Array:
    """(N,) site time of the observations, seconds from t_mid."""
    row = data.pixels[:, 1] / camera.lens.size_px[1]
    return data.t_s + camera.clock_offset_s + camera.clock_rate * data.t_s + camera.readout_s * row


def project(camera: Camera, data: CameraData, flight: Flight, control: Array) -> Projected:
    """Residuals and derivatives of one camera's observations of the flight with control points (M, 3)."""
    t = site_time_s(camera, data)
    stretch = flight.stretch_of(t, data.target)
    located = flight.locate(t, np.maximum(stretch, 0))
    in_camera = (evaluate(located, control) - camera.centre_enu) @ camera.R_cam_enu.T
    in_front = in_camera[:, 2] > NEAREST_DEPTH
    depth = np.where(in_front, in_camera[:, 2], 1.0)
    ray = np.where(in_front[:, None], in_camera[:, :2] / depth[:, None], 0.0)
    image = distort(camera.lens, ray)
    focal, principal = np.array(camera.lens.intrinsics[:2]), np.array(camera.lens.intrinsics[2:])
    residual = image.xy * focal + principal - data.pixels

    by_in_camera = np.empty((len(t), 2, 3))
    by_ray = image.by_ray * focal[:, None] / depth[:, None, None]
    by_in_camera[:, :, :2] = by_ray
    by_in_camera[:, :, 2] = -np.einsum("nij,nj->ni", by_ray, ray)
    by_point = by_in_camera @ camera.R_cam_enu

    by_camera = np.zeros((len(t), 2, CAMERA_SIZE))
    # d(exp(w) p)/dw = -[p]x, so each row of the derivative is the row of by_in_camera crossed with p.
    by_camera[:, :, ROTATION] = np.cross(in_camera[:, None, :], by_in_camera)
    by_camera[:, :, CENTRE] = -by_point
    by_time = np.einsum("nij,nj->ni", by_point, velocity(located, control))
    by_camera[:, :, OFFSET] = by_time
    by_camera[:, :, RATE] = by_time * data.t_s[:, None]
    by_camera[:, :, READOUT] = by_time * (data.pixels[:, 1] / camera.lens.size_px[1])[:, None]
    by_camera[:, 0, 9] = image.xy[:, 0]
    by_camera[:, 1, 10] = image.xy[:, 1]
    by_camera[:, 0, 11] = by_camera[:, 1, 12] = 1.0
    by_camera[:, :, 13] = image.by_coefficient * focal
    return Projected(residual, by_point, by_camera, located, in_front & (stretch >= 0))
