"""How level the pictures are: a witness for which way is up that no survey knows of.

The hazard is the world that leans. A wrong height of one of three tripods, or of two neighbours of four, tilts the
whole network by ten degrees and contradicts nothing: the cameras' shape is the same, and so are the pixels. But people
put cameras level, by a bubble or by eye. If all of them hang askew, and one slip in the survey would set all upright at
once, that slip is no longer unlikely. Not everybody levels: where the pictures are askew whatever is wrong, they say
nothing.
"""

from typing import Final

import numpy as np
from scipy import stats

from calib.adjustment.projection import CAMERA_SIZE, ROTATION
from calib.network import Camera
from calib.observations import SiteCamera
from calib.solving.pixel_information import Beside
from edge.common.arrays import Array

# How askew a site's pictures are, one sigma (rad), and how often.
SITES: Final = (
    (0.015, 0.4),  # by the tripod's bubble
    (0.05, 0.3),  # by eye
    (0.4, 0.3),  # strapped to poles and branches
)


def log_likelihood(sines: Array) -> float:
    """Of pictures (M,) as level as these, on a site of any kind."""
    each = [np.log(share) + stats.norm.logpdf(sines, scale=askew_rad).sum() for askew_rad, share in SITES]
    return float(np.logaddexp.reduce(each))


def levels(cameras: tuple[Camera, ...], sites: dict[str, SiteCamera]) -> Beside:
    """The sine of each picture's roll, portrait ones stood up: M cameras that do not know themselves where up is."""
    values, rows = [], []
    for index, camera in enumerate(cameras):
        if sites[camera.id].up_cam is not None:
            continue
        up = camera.R_cam_enu[:, 2]
        axis = int(np.abs(up[1]) < np.abs(up[0]))  # x is level in landscape, y in portrait
        row = np.zeros(CAMERA_SIZE * len(cameras))
        row[CAMERA_SIZE * index : CAMERA_SIZE * (index + 1)][ROTATION] = _turned(up, axis)
        values.append(up[axis])
        rows.append(row)
    size = CAMERA_SIZE * len(cameras)
    return Beside(np.array(values), np.array(rows).reshape(-1, size), np.full(len(values), SITES[0][0]))


def _turned(up: Array, axis: int) -> Array:
    """(3,) derivative of one component of up in a camera's frame, by a small rotation of the camera."""
    return np.asarray(np.cross(up, np.eye(3)[axis]), float)
