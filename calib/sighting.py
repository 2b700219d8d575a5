"""What a calibrated camera should see of a point, and how that changes with the point and with the camera's pose.

The hazard is the far side of the lens model: behind the camera, or outside the image, a polynomial happily folds a
point back into the picture. So every projection says whether it is valid, by a radius fixed once per camera.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.network import POSE_SIZE, Camera
from edge.common.arrays import Array
from edge.lens import Distorted, distort, pixel_to_ray

BORDER_STEPS: Final = 24  # pixels looked at along each edge of the image to find its widest ray
# A point this near (or behind) has no image: its derivatives would explode.
NEAREST_DEPTH_M: Final = 1e-6
MARGIN: Final = 1.02  # of that radius: a prediction may lie a little outside


@dataclass(frozen=True)
class Sighting:
    """Predicted pixels (N, 2), their derivative by the point (N, 2, 3) and by the pose (N, 2, 6), and whether valid."""

    pixels: Array
    by_point: Array
    by_pose: Array
    valid: NDArray[np.bool_]

    def chosen(self, which: NDArray[np.intp]) -> "Sighting":
        """Those of indices (M,)."""
        return Sighting(self.pixels[which], self.by_point[which], self.by_pose[which], self.valid[which])


def sight(camera: Camera, points_enu: Array, widest_ray: float = np.inf) -> tuple[Sighting, Distorted]:
    """Where a camera should see points (N, 3) in ENU metres, and how its lens bends their rays there.

    The collinearity equations with their derivatives. widest_ray: norm of the ray beyond which the lens model is not to
    be asked. Invalid rows hold no usable numbers, but finite ones.
    """
    in_camera = (points_enu - camera.centre_enu) @ camera.R_cam_enu.T
    ahead = in_camera[:, 2] > NEAREST_DEPTH_M
    depth = np.where(ahead, in_camera[:, 2], 1.0)
    rays = in_camera[:, :2] / depth[:, None]
    valid = ahead & (np.einsum("ni,ni->n", rays, rays) < widest_ray**2)
    rays = np.where(valid[:, None], rays, 0.0)
    bent = distort(camera.lens, rays)
    focal = np.array(camera.lens.intrinsics[:2])
    by_ray = bent.by_ray * focal[:, None]
    by_camera = np.empty((len(rays), 2, 3))
    by_camera[:, :, :2] = by_ray / depth[:, None, None]
    by_camera[:, :, 2] = -np.matmul(by_ray, rays[:, :, None])[:, :, 0] / depth[:, None]
    by_point = by_camera @ camera.R_cam_enu
    by_pose = np.empty((len(rays), 2, POSE_SIZE))
    # d(exp(w) p)/dw = -[p]x, so each row of the derivative is the row of by_camera crossed with p.
    by_pose[:, :, :3] = _cross(in_camera, by_camera)
    by_pose[:, :, 3:] = -by_point
    return Sighting(bent.xy * focal + camera.lens.intrinsics[2:], by_point, by_pose, valid), bent


def by_lens(camera: Camera, bent: Distorted) -> Array:
    """(N, 2, 5) derivative of pixels by fx, fy, cx, cy and the refined coefficient of the lens."""
    derivative = np.zeros((len(bent.xy), 2, 5))
    derivative[:, 0, 0], derivative[:, 1, 1] = bent.xy.T
    derivative[:, 0, 2] = derivative[:, 1, 3] = 1.0
    derivative[:, :, 4] = bent.by_coefficient * camera.lens.intrinsics[:2]
    return derivative


@dataclass(frozen=True)
class CameraView:
    """A camera with what every projection needs at hand. widest_ray: norm of the ray at the image's farthest corner."""

    camera: Camera
    widest_ray: float

    @classmethod
    def of(cls, camera: Camera) -> "CameraView":
        """The view of a camera."""
        width, height = camera.lens.size_px
        along = np.linspace(0.0, 1.0, BORDER_STEPS)
        edges = [np.column_stack([along, np.full(BORDER_STEPS, side)]) for side in (0.0, 1.0)]
        border = np.vstack([*edges, *(edge[:, ::-1] for edge in edges)]) * (width - 1, height - 1)
        radii = np.linalg.norm(pixel_to_ray(camera.lens, border), axis=1)
        return cls(camera, float(np.nanmax(radii, initial=0.1)) * MARGIN)

    def sight(self, points_enu: Array) -> Sighting:
        """Where points (N, 3) in ENU metres should be seen. Invalid rows hold no usable numbers."""
        return sight(self.camera, points_enu, self.widest_ray)[0]

    def inside(self, pixels: Array, margin_px: float = 0.0) -> np.ndarray:
        """Which pixels (N, 2) lie in the image, at least margin_px from its edge."""
        width, height = self.camera.lens.size_px
        u, v = pixels[:, 0], pixels[:, 1]
        return (u >= margin_px) & (u <= width - 1 - margin_px) & (v >= margin_px) & (v <= height - 1 - margin_px)


def _cross(points: Array, rows: Array) -> Array:
    """(N, 2, 3) cross products of points (N, 3) with rows (N, 2, 3); numpy's own takes ten times as long."""
    x, y, z = points[:, 0, None], points[:, 1, None], points[:, 2, None]
    a, b, c = rows[:, :, 0], rows[:, :, 1], rows[:, :, 2]
    product = np.empty(rows.shape)
    product[:, :, 0], product[:, :, 1], product[:, :, 2] = y * c - z * b, z * a - x * c, x * b - y * a
    return product
