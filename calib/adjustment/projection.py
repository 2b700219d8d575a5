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
from calib.network import POSE_SIZE, Camera
from calib.sighting import by_lens, sight
from edge.common.arrays import Array

# The unknowns of one camera, in the order of every Jacobian's columns.
POSE: Final = slice(0, POSE_SIZE)  # the two that follow
ROTATION: Final = slice(0, 3)  # rad, camera frame: R = exp(rotation) R_cam_enu
CENTRE: Final = slice(3, 6)  # m, ENU
OFFSET: Final = 6  # s
RATE: Final = 7  # s/s
READOUT: Final = 8  # s
LENS: Final = slice(9, 14)  # fx, fy, cx, cy (px), the distortion's refined coefficient
CAMERA_SIZE: Final = 14


def unknowns_of(index: int) -> slice:
    """Where the unknowns of the camera of that index stand among those of all."""
    return slice(CAMERA_SIZE * index, CAMERA_SIZE * (index + 1))


def centre_of(index: int) -> slice:
    """Where its centre stands among them."""
    return slice(CAMERA_SIZE * index + CENTRE.start, CAMERA_SIZE * index + CENTRE.stop)


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
    return camera.exposed_s(data.t_s, data.pixels[:, 1])


def project(camera: Camera, data: CameraData, flight: Flight, control: Array) -> Projected:
    """Residuals and derivatives of one camera's observations of the flight with control points (M, 3)."""
    t = site_time_s(camera, data)
    stretch = flight.stretch_of(t, data.target)
    located = flight.locate(t, np.maximum(stretch, 0))
    image, bent = sight(camera, evaluate(located, control))
    by_camera = np.empty((len(t), 2, CAMERA_SIZE))
    by_camera[:, :, POSE] = image.by_pose
    # The object moves on while the clock does: dX/dt is the spline's velocity, and the clock's three shift t.
    by_time = np.einsum("nij,nj->ni", image.by_point, velocity(located, control))
    by_camera[:, :, OFFSET] = by_time
    by_camera[:, :, RATE] = by_time * data.t_s[:, None]
    by_camera[:, :, READOUT] = by_time * (data.pixels[:, 1] / camera.lens.size_px[1])[:, None]
    by_camera[:, :, LENS] = by_lens(camera, bent)
    return Projected(image.pixels - data.pixels, image.by_point, by_camera, located, image.valid & (stretch >= 0))
