"""A camera as it truly is: where it looks, also after a knock, and which row of which frame sees an object when.

The hazard is a simulation that shares its approximations with the solver. Here the stamp is rounded to a nanosecond
first and the object's place computed for that very stamp, and the rolling shutter, whose row depends on the place and
the place on the row, is iterated until nothing changes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.geometry.rotation import rotation
from calib.simulation import description
from calib.simulation.flight import ObjectFlight
from edge.common.arrays import Array
from edge.common.errors import ConfigError
from edge.lens import LensModel, pixel_to_ray, ray_to_pixel

SHUTTER_STEPS = 20  # each gains a factor readout * image speed / height, below 0.1
SHUTTER_DONE_PX = 1e-10  # below what any double of a pixel near 1000 can hold


@dataclass(frozen=True)
class TrueCamera:
    """A camera's truth. R_cam_enu: (K, 3, 3) and centre_enu: (K, 3) hold from since_s (K,) on; the first is -inf."""

    description: description.CameraSpec
    lens: LensModel
    since_s: Array
    R_cam_enu: Array
    centre_enu: Array
    t_mid_s: float

    def stamps_ns(self, duration_s: float) -> NDArray[np.int64]:
        """(F,) nanoseconds since the scene's start on the camera's own clock, before any frame is dropped."""
        d = self.description
        count = d.frames if d.frames is not None else int(np.floor((duration_s - d.phase_s) * d.frame_rate_hz)) + 1
        stamps: NDArray[np.int64] = np.round((d.phase_s + np.arange(count) / d.frame_rate_hz) * 1e9).astype(np.int64)
        return stamps

    def site_time_s(self, stamps_ns: NDArray[np.int64], rows_px: Array | float = 0.0) -> Array:
        """(N,) seconds of the site's time at which rows_px of the frames were exposed (deploy/ARCHITECTURE.md)."""
        d, t = self.description, stamps_ns * 1e-9
        stepped = sum((np.where(t >= step.at_s, -step.step_s, 0.0) for step in d.clock_step), np.zeros(len(t)))
        drifted = d.clock_offset_s + d.clock_rate * (t - self.t_mid_s)
        site_time: Array = np.asarray(t + drifted + stepped + d.readout_s * rows_px / self.lens.size_px[1])
        return site_time

    def in_camera(self, points_enu: Array, t_s: Array) -> Array:
        """(N, 3) metres in the camera frame of points (N, 3) at t_s (N,), with the pose that held then."""
        pose = np.searchsorted(self.since_s, t_s, side="right") - 1
        offset = points_enu - self.centre_enu[pose]
        if len(self.since_s) == 1:
            return np.asarray(offset @ self.R_cam_enu[0].T)
        return np.asarray(np.einsum("nij,nj->ni", self.R_cam_enu[pose], offset))

    def project(self, points_enu: Array, t_s: Array) -> tuple[Array, Array]:
        """Raw pixels (N, 2) and depths (N,) in metres; NaN behind the camera or beyond the image and the lens."""
        in_camera = self.in_camera(points_enu, t_s)
        depth = np.where(in_camera[:, 2] > 0, in_camera[:, 2], np.nan)
        rays = in_camera[:, :2] / depth[:, None]
        pixels = ray_to_pixel(self.lens, rays)
        seen = np.all((pixels >= 0) & (pixels <= np.array(self.lens.size_px) - 1.0), axis=1)
        if not self.lens.is_pinhole:
            # A polynomial folds far rays back into the image: only what the lens takes back the same way is seen.
            seen[seen] = np.abs(pixel_to_ray(self.lens, pixels[seen]) - rays[seen]).max(axis=1, initial=0.0) < 1e-6
        return np.where(seen[:, None], pixels, np.nan), np.where(seen, depth, np.nan)

    def watch(self, flight: ObjectFlight, stamps_ns: NDArray[np.int64]) -> "TrueSighting":
        """What frames stamped stamps_ns (N,) show of a flight; NaN where they do not show it."""
        rows: Array = np.full(len(stamps_ns), self.lens.size_px[1] / 2.0)
        for _ in range(SHUTTER_STEPS if self.description.readout_s else 1):
            t_s = self.site_time_s(stamps_ns, rows)
            pixels, depth = self.project(flight.position_enu(t_s), t_s)
            moved = np.nanmax(np.abs(pixels[:, 1] - rows), initial=0.0)
            rows = np.where(np.isnan(pixels[:, 1]), rows, pixels[:, 1])
            if moved < SHUTTER_DONE_PX:
                break
        return TrueSighting(t_s, pixels, depth)


@dataclass(frozen=True)
class TrueSighting:
    """What a camera's frames show of one object: site time (N,), raw pixels (N, 2), depth (N,) in metres."""

    t_s: Array
    pixels: Array
    depth_m: Array


def true_camera(camera: description.CameraSpec, t_mid_s: float) -> TrueCamera:
    """The camera a description asks for. Raises ConfigError if it cannot be aimed, LensError if it has no lens."""
    lens = LensModel(camera.lens, camera.intrinsics, tuple(camera.distortion), camera.size_px)
    bumps = sorted(camera.bump, key=lambda bump: bump.at_s)
    rotations, centres = [_aim(camera)], [np.asarray(camera.centre_enu, float)]
    for bump in bumps:
        rotations.append(rotation(np.radians(bump.rotation_deg)) @ rotations[-1])
        centres.append(centres[-1] + bump.shift_m)
    since = np.array([-np.inf, *(bump.at_s for bump in bumps)])
    return TrueCamera(camera, lens, since, np.array(rotations), np.array(centres), t_mid_s)


def _aim(camera: description.CameraSpec) -> Array:
    """(3, 3) R_cam_enu: z along the line of sight, x level and to the right, then rolled."""
    if camera.look_at_enu is not None:
        forward = np.subtract(camera.look_at_enu, camera.centre_enu)
    else:
        heading, elevation = np.radians([camera.heading_deg, camera.elevation_deg])
        level = np.cos(elevation)
        forward = np.array([level * np.sin(heading), level * np.cos(heading), np.sin(elevation)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-9 * max(1.0, float(np.linalg.norm(forward))):
        raise ConfigError(
            "looks straight up or at itself", where=f"camera {camera.id}", action="aim it a little off the vertical"
        )
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    roll = rotation([0.0, 0.0, -np.radians(camera.roll_deg)])
    return np.asarray(roll @ [right, np.cross(forward, right), forward])
