"""Where the raw tracks of two cameras meet.

The hazard is the wrong partner: with twenty objects in each picture, some ray always passes near. So tracks are
compared over a second of common time, each track has one partner at most, and the best pairs are chosen first.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.geometry.rays import LEAST_SINE2, nearest_point
from calib.guarding.raytracks import SAMPLES, RayTracks
from calib.network import Camera, Network, attitude_of
from edge.common.arrays import Array

MATCH_SIGMA: Final = 3.0  # two rays meet
NOISE_SHARE: Final = 0.6  # of a network's residual, in the median of SAMPLES detections
LEAST_NOISE_PX: Final = 0.4  # a lens model is no better
MIN_COMMON: Final = 4  # instants, of SAMPLES, that both tracks must have
NEAREST_M: Final = 1.0


@dataclass(frozen=True)
class Meetings:
    """M pairs of tracks that meet: times (M, S) s, points (M, S, 3) ENU m.

    noise_m, expected_m: (M, S) one sigma of the points by pixels, and by the calibration. noise_px: of a track's median
    pixel. miss_rad: how well the rays meet, median.
    """

    t_s: Array
    points: Array
    noise_m: Array
    expected_m: Array
    noise_px: float
    miss_rad: float


def meetings(
    network: Network, pair: tuple[str, str], tracks: RayTracks, since_unix_ns: int
) -> tuple[Meetings | None, bool]:
    """Where tracks of two cameras meet, if any do; and whether any had enough common time to."""
    one, other = network.camera(pair[0]), network.camera(pair[1])
    assert one is not None
    assert other is not None
    of_one, of_other = tracks.of(one, network, since_unix_ns), tracks.of(other, network, since_unix_ns)
    if not of_one or not of_other:
        return None, False
    t_s = np.stack([np.linspace(track.t_s[0], track.t_s[-1], SAMPLES) for track in of_one])
    own = np.stack([track.at(times) for track, times in zip(of_one, t_s, strict=True)])
    theirs = np.stack([rival.at(t_s.ravel()) for rival in of_other], axis=1)
    theirs = theirs.reshape(len(of_one), SAMPLES, len(of_other), 2).transpose(0, 2, 1, 3)
    common = np.isfinite(theirs[..., 0]) & np.isfinite(own[:, None, :, 0])
    possible = common.sum(axis=2) >= MIN_COMMON
    if not possible.any():
        return None, False
    a = _bearings(one, own)[:, None]
    b = _bearings(other, theirs)
    noise_px = max(LEAST_NOISE_PX, NOISE_SHARE * network.rms_px)
    crossing = _cross(one, other, a, b)
    noise_m = crossing.spread([noise_px / min(camera.lens.intrinsics[:2]) for camera in (one, other)])
    expected_m = crossing.spread([attitude_sigma(network, camera.id) for camera in (one, other)])
    miss = np.where(possible, median_low(crossing.gap / np.hypot(noise_m, expected_m)), np.inf)
    miss = np.where(median_low(crossing.nearest_m) > NEAREST_M, miss, np.inf)
    chosen = _choose(miss)
    if not chosen:
        return None, True
    at = tuple(np.array(chosen).T)
    angle = median_low(crossing.gap / np.maximum(crossing.nearest_m, NEAREST_M))[at]
    points = _without_gaps(crossing.points[at])
    noise_m, expected_m = noise_m[at] / crossing.sine[at], expected_m[at] / crossing.sine[at]
    return Meetings(t_s[at[0]], points, noise_m, expected_m, noise_px, float(np.median(angle))), True


def _bearings(camera: Camera, pixels: Array) -> Array:
    """Bearings (..., 3) of pixels (..., 2); NaN stays NaN."""
    flat = pixels.reshape(-1, 2)
    known = np.isfinite(flat[:, 0])
    bearings = np.full((len(flat), 3), np.nan)
    bearings[known] = camera.bearings_enu(flat[known])
    return bearings.reshape(*pixels.shape[:-1], 3)


@dataclass(frozen=True)
class _Crossing:
    """Of rays of A tracks and B tracks at S instants: all (A, B, S), points (A, B, S, 3); NaN where there is none."""

    points: Array
    gap: Array
    ranges: tuple[Array, Array]
    sine: Array

    @property
    def nearest_m(self) -> Array:
        return np.minimum(*self.ranges)

    def spread(self, sigma_rad: list[float]) -> Array:
        """One sigma of the gap, for two cameras' bearings of that sigma."""
        return np.hypot(sigma_rad[0] * self.ranges[0], sigma_rad[1] * self.ranges[1])


def _cross(one: Camera, other: Camera, a: Array, b: Array) -> _Crossing:
    """Rays a (A, 1, S, 3) of one camera and b (A, B, S, 3) of another."""
    near = nearest_point(one.centre_enu, a, other.centre_enu, b)
    steep = near.sine2 > LEAST_SINE2
    points = np.where(steep[..., None], near.points, np.nan)
    ranges = np.where(steep, near.range_a_m, np.nan), near.range_b_m
    return _Crossing(points, np.where(steep, near.gap_m, np.nan), ranges, np.sqrt(near.sine2))


def _choose(miss: Array) -> list[tuple[int, int]]:
    """Pairs (row, column) that meet, best first, each row and column once."""
    rows, columns = np.nonzero(miss < MATCH_SIGMA)
    chosen: list[tuple[int, int]] = []
    for k in np.argsort(miss[rows, columns]):
        row, column = int(rows[k]), int(columns[k])
        if all(row != r and column != c for r, c in chosen):
            chosen.append((row, column))
    return chosen


def _without_gaps(points: Array) -> Array:
    """Points (M, S, 3) with missing ones replaced by their track's median."""
    middle = median_low(np.moveaxis(points, 1, 2))
    return np.where(np.isfinite(points), points, middle[:, None, :])


def median_low(values: Array) -> Array:
    """Lower median over the last axis of what is not NaN; NaN where nothing is. Ten times as fast as nanmedian."""
    ordered = np.sort(values, axis=-1)
    count = np.isfinite(ordered).sum(axis=-1)
    at = np.maximum(count - 1, 0) // 2
    median: Array = np.take_along_axis(ordered, at[..., None], axis=-1)[..., 0]
    return np.where(count > 0, median, np.nan)


def attitude_sigma(network: Network, camera_id: str) -> float:
    """One sigma, rad, of the worst axis of a camera's attitude."""
    at = attitude_of([camera.id for camera in network.cameras].index(camera_id))
    return float(np.sqrt(np.max(np.diag(network.covariance)[at])))
