"""Readmission: cameras that were left out, resected again once the others are adjusted.

The hazard is giving up too early: against a scaffold built on lenses that are two per cent off, a camera that shares
only a minute with the pair, or whose clock is far off, explains nothing. Against the refined flight it does, and if it
still does not, it is not a matter of patience. The other hazard is to find it a clock at any price: some offset is
always the best one, so one is taken only where it stands out.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from calib.adjustment.flight import FlightEstimate
from calib.geometry.resection import FEWEST_POINTS, Resection, resect
from calib.geometry.similarity import UNCHANGED
from calib.geometry.spline import evaluate
from calib.network import Camera
from calib.observations import SiteCamera
from calib.solving.bootstrap import to_enu
from calib.solving.clock_consensus import CLEAR_SCORE, CONTRAST_NEAR, Clock
from calib.solving.clock_correlation import SMALLEST_MISFIT
from calib.solving.clocks import CONTRAST, CONVINCING, FINE_STEP_S, INDEPENDENT_S, NEAR_S
from calib.solving.identity import Key
from calib.solving.scaffold import FAIR_SHARE, Pose, threshold_ray
from calib.solving.series import TrackSeries, even
from edge.common.arrays import Array

COARSE_STEP_S: Final = 0.1  # a UAV at 10 m/s and 100 m moves 10 mrad in it: well inside the cliff's width
FAR_S: Final = 120.0  # clocks that were set by hand
ONE_OPTIMUM_S: Final = 1.0  # offsets nearer to the best than this are the same optimum
PROJECTION_UNKNOWNS: Final = 5.5  # rows that a projection of eleven unknowns fits anyway, two equations each
TRIED_ROWS: Final = 300  # of a track that are tried
PATIENCE: Final = 3.0  # times the scaffold's threshold: the adjustment weighs a poor camera by its own residuals


def readmit(
    estimate: FlightEstimate,
    tracks: dict[str, list[TrackSeries]],
    sites: dict[str, SiteCamera],
    objects: dict[Key, int],
    clocks: dict[str, Clock],
) -> tuple[Camera, ...]:
    """Cameras that resect into the refined flight; their tracks are entered into `objects`.

    clocks: of the cameras whose clocks are known; those of the others are searched for.
    """
    present = {camera.id for camera in estimate.cameras}
    known = _on_time_of(estimate, clocks)
    back = []
    for name in sorted(set(tracks) - present):
        found = _best(estimate, tracks[name], known.get(name))
        if found:
            track, target, clock, pose = found
            objects[name, track.number] = target
            back.append(replace(to_enu(pose, sites[name], UNCHANGED, clock.offset_s), clock_rate=clock.rate))
    return tuple(back)


def _on_time_of(estimate: FlightEstimate, clocks: dict[str, Clock]) -> dict[str, Clock]:
    """The clocks against the estimate's time, which may have been set by another camera since."""
    later = [c.clock_offset_s - clocks[c.id].offset_s for c in estimate.cameras if c.id in clocks]
    shift_s = float(np.median(later)) if later else 0.0
    return {name: Clock(clock.offset_s + shift_s, clock.rate) for name, clock in clocks.items()}


def _best(
    estimate: FlightEstimate, tracks: list[TrackSeries], known: Clock | None
) -> tuple[TrackSeries, int, Clock, Pose] | None:
    found: list[tuple[float, TrackSeries, int, Clock, Pose]] = []
    for track in tracks[:3]:
        for target in np.unique(estimate.flight.target).tolist():
            for clock in _clocks(estimate, track, target, known):
                pose = _resect(estimate, track, target, clock)
                if pose and pose.share >= FAIR_SHARE:
                    found.append((pose.share, track, target, clock, pose))
                    break
    if not found:
        return None
    _, track, target, clock, pose = max(found, key=lambda entry: entry[0])
    return track, target, clock, pose


def _clocks(estimate: FlightEstimate, track: TrackSeries, target: int, known: Clock | None) -> list[Clock]:
    """What a track's clock may be: what is known of it, else where it stands out, near or within two minutes."""
    if known is not None:
        near = _search(estimate, track, target, known, NEAR_S)
        return [near, known] if near else [known]
    tried = (_search(estimate, track, target, Clock(), reach_s) for reach_s in (NEAR_S, FAR_S))
    return [clock for clock in tried if clock]


def _points(estimate: FlightEstimate, track: TrackSeries, target: int, clock: Clock) -> tuple[Array, Array]:
    """Where the object was (N, 3) at a track's rows (N, 2) that lie on the flight."""
    chosen = even(len(track.t_s), TRIED_ROWS)
    t = track.t_s[chosen] * (1 + clock.rate) + clock.offset_s
    stretch = estimate.flight.stretch_of(t, np.full(len(t), target, np.int64))
    on = stretch >= 0
    return evaluate(estimate.flight.locate(t[on], stretch[on]), estimate.control), track.rays[chosen][on]


def _resect(estimate: FlightEstimate, track: TrackSeries, target: int, clock: Clock) -> Pose | None:
    points, rays = _points(estimate, track, target, clock)
    found: Resection | None = resect(points, rays, PATIENCE * threshold_ray([[track]]))
    return Pose(found.R, found.centre, found.share) if found else None


def _search(estimate: FlightEstimate, track: TrackSeries, target: int, about: Clock, reach_s: float) -> Clock | None:
    """The clock within +-reach seconds at which some projection (any 3 x 4 matrix) explains the track beyond doubt."""
    offsets = about.offset_s + np.arange(-reach_s, reach_s + COARSE_STEP_S / 2, COARSE_STEP_S)
    score = _scores(estimate, track, target, offsets, about.rate)
    at = int(np.argmax(score))
    elsewhere = float(np.max(np.where(np.abs(offsets - offsets[at]) > ONE_OPTIMUM_S, score, 0.0)))
    least, contrast = (CLEAR_SCORE, CONTRAST_NEAR) if reach_s <= NEAR_S else (CONVINCING, CONTRAST)
    if at in (0, len(offsets) - 1) or score[at] < max(least, contrast * elsewhere):
        return None
    fine = offsets[at] + np.arange(-COARSE_STEP_S, COARSE_STEP_S + FINE_STEP_S / 2, FINE_STEP_S)
    best = int(np.argmax(_scores(estimate, track, target, fine, about.rate)))
    return Clock(float(fine[best]), about.rate)


def _scores(estimate: FlightEstimate, track: TrackSeries, target: int, offsets: Array, rate: float) -> Array:
    """(K,) log likelihood of each offset against the typical one's; zero where hardly anything is left to compare."""
    misfits = [_misfit(*_points(estimate, track, target, Clock(float(offset), rate))) for offset in offsets]
    logs, rows = (np.array(column, float) for column in zip(*misfits, strict=True))
    share = min(len(track.t_s), TRIED_ROWS)
    seen_s = rows / share * len(track.t_s) * float(np.median(np.diff(track.t_s)))
    free = np.maximum(seen_s / INDEPENDENT_S - PROJECTION_UNKNOWNS, 0.0)
    if not (free > 0).any():
        return np.zeros(len(offsets))
    score: Array = free * (float(np.median(logs[free > 0])) - logs)
    return score


def _misfit(points: Array, rays: Array) -> tuple[float, int]:
    """Log of the smallest eigenvalue a row of the direct linear system (Abdel-Aziz and Karara 1971); rows."""
    if len(points) < 2 * FEWEST_POINTS:
        return 0.0, 0
    X = np.column_stack([(points - points.mean(0)) / max(float(points.std()), 1e-12), np.ones(len(points))])
    x = (rays - rays.mean(0)) / max(float(rays.std()), 1e-12)
    zero = np.zeros_like(X)
    A = np.concatenate([np.hstack([X, zero, -x[:, :1] * X]), np.hstack([zero, X, -x[:, 1:] * X])])
    smallest = float(np.linalg.eigvalsh(A.T @ A)[0]) / len(points)
    return float(np.log(max(smallest, SMALLEST_MISFIT))), len(points)
