"""Readmission: cameras that were left out, resected again once the others are adjusted.

The hazard is giving up too early: against a scaffold built on lenses that are two per cent off, a camera that shares
only a minute with the pair, or whose clock is far off, explains nothing. Against the refined flight it does, and if it
still does not, it is not a matter of patience.
"""

from typing import Final

import numpy as np

from calib.adjustment.flight import FlightEstimate
from calib.geometry.resection import FEWEST_POINTS, Resection, resect
from calib.geometry.similarity import UNCHANGED
from calib.geometry.spline import evaluate
from calib.network import Camera
from calib.observations import SiteCamera
from calib.solving.bootstrap import to_enu
from calib.solving.clocks import COARSE_STEP_S, FAR_S, FINE_STEP_S, NEAR_S
from calib.solving.identity import Key
from calib.solving.scaffold import FAIR_SHARE, Pose, threshold_ray
from calib.solving.series import TrackSeries, even
from edge.common.arrays import Array

TRIED_ROWS: Final = 300  # of a track that are tried
PATIENCE: Final = 3.0  # times the scaffold's threshold: the adjustment weighs a poor camera by its own residuals


def readmit(
    estimate: FlightEstimate,
    tracks: dict[str, list[TrackSeries]],
    sites: dict[str, SiteCamera],
    objects: dict[Key, int],
) -> tuple[Camera, ...]:
    """Cameras that resect into the refined flight; their tracks are entered into `objects`."""
    present = {camera.id for camera in estimate.cameras}
    back = []
    for name in sorted(set(tracks) - present):
        found = _best(estimate, tracks[name])
        if found:
            track, target, offset_s, pose = found
            objects[name, track.number] = target
            back.append(to_enu(pose, sites[name], UNCHANGED, offset_s))
    return tuple(back)


def _best(estimate: FlightEstimate, tracks: list[TrackSeries]) -> tuple[TrackSeries, int, float, Pose] | None:
    found: list[tuple[float, TrackSeries, int, float, Pose]] = []
    for track in tracks[:3]:
        for target in np.unique(estimate.flight.target).tolist():
            for reach_s in (NEAR_S, FAR_S):
                offset_s = _clock(estimate, track, target, reach_s)
                pose = _resect(estimate, track, target, offset_s)
                if pose and pose.share >= FAIR_SHARE:
                    found.append((pose.share, track, target, offset_s, pose))
                    break
    if not found:
        return None
    _, track, target, offset_s, pose = max(found, key=lambda entry: entry[0])
    return track, target, offset_s, pose


def _points(estimate: FlightEstimate, track: TrackSeries, target: int, offset_s: float) -> tuple[Array, Array]:
    """Where the object was (N, 3) at a track's rows (N, 2) that lie on the flight."""
    chosen = even(len(track.t_s), TRIED_ROWS)
    t = track.t_s[chosen] + offset_s
    stretch = estimate.flight.stretch_of(t, np.full(len(t), target, np.int64))
    on = stretch >= 0
    return evaluate(estimate.flight.locate(t[on], stretch[on]), estimate.control), track.rays[chosen][on]


def _resect(estimate: FlightEstimate, track: TrackSeries, target: int, offset_s: float) -> Pose | None:
    points, rays = _points(estimate, track, target, offset_s)
    found: Resection | None = resect(points, rays, PATIENCE * threshold_ray([[track]]))
    return Pose(found.R, found.centre, found.share) if found else None


def _clock(estimate: FlightEstimate, track: TrackSeries, target: int, reach: float) -> float:
    """The offset within +-reach seconds at which some projection (any 3 x 4 matrix) explains the track best."""
    best, step = 0.0, COARSE_STEP_S
    while step >= FINE_STEP_S / 2:
        offsets = best + np.arange(-reach, reach + step / 2, step)
        best = float(offsets[int(np.argmin([_misfit(*_points(estimate, track, target, o)) for o in offsets]))])
        reach, step = step, step / 10
    return best


def _misfit(points: Array, rays: Array) -> float:
    """Smallest eigenvalue a row of the direct linear system (Abdel-Aziz and Karara 1971)."""
    if len(points) < 2 * FEWEST_POINTS:
        return np.inf
    X = np.column_stack([(points - points.mean(0)) / max(float(points.std()), 1e-12), np.ones(len(points))])
    x = (rays - rays.mean(0)) / max(float(rays.std()), 1e-12)
    zero = np.zeros_like(X)
    A = np.concatenate([np.hstack([X, zero, -x[:, :1] * X]), np.hstack([zero, X, -x[:, 1:] * X])])
    return float(np.linalg.eigvalsh(A.T @ A)[0]) / len(points)
