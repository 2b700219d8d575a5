"""One slice of time as one camera saw it: its tracks at the slice's instants, and how well each of them is known.

The hazard is a sigma that counts only noise. A box's centre is off by a share of the box, and for seconds; a camera's
attitude and clock are known to so much and no better. What such an error may be belongs to what is allowed, else every
honest camera is off by more than it says.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.guarding.meetings import LEAST_NOISE_PX, attitude_sigma
from calib.guarding.raytracks import RayTrack
from calib.network import Camera, Network
from calib.sighting import CameraView
from edge.common.arrays import Array

LASTING_PX: Final = 0.3  # one sigma of a lens model's error, which stays while an object passes
UNSAID_WIDTH_PX: Final = 8.0  # of a box that nobody told the width of
FADES_S: Final = 0.1  # s: errors gone so soon are noise
LASTS_S: Final = 1.0  # s: errors that stay so long are no noise at all
MEDIAN_SHARE: Final = 0.6  # of the noise, in the median of a slice's instants
BETWEEN_ROWS: Final = 0.82  # of a row's noise, in a pixel between two: sqrt(2 / 3) in the mean
INSTANTS_APART_S: Final = 0.1  # between a slice's instants


@dataclass(frozen=True)
class CameraLook:
    """K tracks of a camera at S instants.

    labels: (K,) the camera's own numbers. pixels: (K, S, 2), NaN where there is none. bearings: (K, S, 3) ENU.
    velocity_px_s: (K, 2). noise_px, lasting_px: (K,) one sigma of what is new at every instant, and of what stays.
    allowed_px: (K,) one sigma of a slice's median pixel, with what attitude and clock are known to.
    """

    view: CameraView
    labels: tuple[int, ...]
    pixels: Array
    bearings: Array
    velocity_px_s: Array
    noise_px: Array
    lasting_px: Array
    width_px: Array
    allowed_px: Array

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def focal_px(self) -> float:
        """The shorter focal length."""
        return float(min(self.view.camera.lens.intrinsics[:2]))


@dataclass(frozen=True)
class Expectations:
    """What an honest camera may be off by. box_share: one sigma of a box's centre, of its width.

    attitude_rad, clock_s: by camera, one sigma.
    """

    rms_px: float
    box_share: float
    attitude_rad: Mapping[str, float]
    clock_s: Mapping[str, float]


def attitudes_rad(network: Network) -> dict[str, float]:
    """One sigma, rad, of the worst axis of each camera's attitude."""
    return {camera.id: attitude_sigma(network, camera.id) for camera in network.cameras}


def look(view: CameraView, tracks: list[RayTrack], t_s: Array, expected: Expectations) -> CameraLook:
    """A camera's tracks at instants t_s (S,)."""
    camera = view.camera
    sampled = [(track, track.at(t_s)) for track in tracks]
    chosen = [(track, pixels) for track, pixels in sampled if np.isfinite(pixels[:, 0]).any()]
    count = len(chosen)
    pixels = np.array([p for _, p in chosen]).reshape(count, len(t_s), 2)
    velocity = np.array([track.velocity_px_s for track, _ in chosen]).reshape(count, 2)
    width = np.array([track.width_px for track, _ in chosen])
    width = np.where(np.isfinite(width), width, UNSAID_WIDTH_PX)
    noise = np.array([_noise_px(camera, track, expected.rms_px) for track, _ in chosen])
    lasting = np.sqrt(LASTING_PX**2 + (expected.box_share * width) ** 2 + _lasting_px(camera) ** 2)
    pose_px = min(camera.lens.intrinsics[:2]) * expected.attitude_rad[camera.id]
    clock_px = np.linalg.norm(velocity, axis=1) * expected.clock_s[camera.id]
    allowed = np.sqrt((MEDIAN_SHARE * noise) ** 2 + lasting**2 + pose_px**2 + clock_px**2)
    return CameraLook(
        view,
        tuple(track.label for track, _ in chosen),
        pixels,
        _bearings(camera, pixels),
        velocity,
        noise,
        lasting,
        width,
        allowed,
    )


def _noise_px(camera: Camera, track: RayTrack, rms_px: float) -> float:
    """One sigma of a track's pixel at an instant; rows rarer than instants say less than their number."""
    found = max(LEAST_NOISE_PX, rms_px, track.rough_px, camera.sigma_px or 0.0)
    return BETWEEN_ROWS * found * float(np.sqrt(max(1.0, track.every_s / INSTANTS_APART_S)))


def _lasting_px(camera: Camera) -> float:
    """What the adjustment found of a camera's pixels that outlives a slice."""
    if camera.sigma_px is None:
        return 0.0
    share = float(np.clip((camera.correlated_s - FADES_S) / (LASTS_S - FADES_S), 0.0, 1.0))
    return camera.sigma_px * float(np.sqrt(share))


def _bearings(camera: Camera, pixels: Array) -> Array:
    """Bearings (..., 3) of pixels (..., 2); NaN stays NaN."""
    flat = pixels.reshape(-1, 2)
    known = np.isfinite(flat[:, 0])
    bearings = np.full((len(flat), 3), np.nan)
    if known.any():
        bearings[known] = camera.bearings_enu(flat[known])
    return bearings.reshape(*pixels.shape[:-1], 3)
