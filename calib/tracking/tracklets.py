"""Short tracks of one camera, and the flights, straight or turning, that several of them may be.

The hazard is overconfidence at initiation: a flight fitted through a second of rays is pulled by every camera's
pointing error at once. So a new track's covariance holds the calibration's too, and how the two hang together goes on
with it.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from calib.network import POSE_SIZE, Network, attitude_of, pose_of
from calib.tracking.motion import STATE
from calib.tracking.options import TrackerOptions
from calib.tracking.searches import Search
from edge.common.arrays import Array

MIN_RAYS: Final = 3  # a line in time through two rays always fits
LEAST_TRACKLET_S: Final = 0.06  # s: two frames at 30 Hz; less says nothing of motion
FRESH: Final = 0.5  # of the span looked at: rays that ended before no longer tell where the object is
MAX_BEND: Final = 6.0  # sigma, median: a hard turn bends a track by less, a number given to another object by more
MAX_FIT: Final = 3.0  # mean squared normalised residual: 1 for a true target, much more for a ghost
SPEED_SIGMAS: Final = 2.0  # by which a speed must be beyond the greatest to be so
SIGMA_FLOOR_M: Final = 0.05  # m: survey and lens errors that the covariance may not know


class LooseRay(NamedTuple):
    """A detection that no target took: camera number, its own track number, site time, pixel, one sigma."""

    camera: int
    label: int
    t_s: float
    u_px: float
    v_px: float
    sigma_px: float


@dataclass(frozen=True)
class Tracklet:
    """Rays of one camera that its own tracker holds for one object.

    t_s: (N,); bearings: (N, 3) unit ENU; sigma_rad; curve: (degree + 1, 3) of the bearing over the seconds since mid_s.
    """

    camera: int
    label: int
    t_s: Array
    bearings: Array
    sigma_rad: float
    mid_s: float
    curve: Array

    def at(self, t_s: float) -> Array:
        """(3,) bearing at a time near its own."""
        bearing: Array = (t_s - self.mid_s) ** np.arange(len(self.curve)) @ self.curve
        return bearing / np.linalg.norm(bearing)


@dataclass(frozen=True)
class NewTrack:
    """A tentative target: state (9,), covariance (9, 9), with the poses (9, 6 C), time; who saw it (camera, label)."""

    state: Array
    covariance: Array
    with_poses: Array
    t_s: float
    seen_by: tuple[tuple[int, int], ...]


def tracklets(rays: Iterable[LooseRay], network: Network, search: Search, now_s: float) -> list[Tracklet]:
    """The short tracks among loose rays: long, fresh and even enough."""
    groups: defaultdict[tuple[int, int], list[LooseRay]] = defaultdict(list)
    for ray in rays:
        if now_s - search.span_s <= ray.t_s <= now_s:
            groups[ray.camera, ray.label].append(ray)
    least = MIN_RAYS - 1 + search.degree
    fresh_s = now_s - FRESH * search.span_s
    made = (
        _tracklet(key, group, network, search.degree)
        for key, group in groups.items()
        if len(group) >= least and max(ray.t_s for ray in group) >= fresh_s
    )
    return [tracklet for tracklet in made if tracklet is not None]


def _tracklet(key: tuple[int, int], rays: list[LooseRay], network: Network, degree: int) -> Tracklet | None:
    t_s = np.array([ray.t_s for ray in rays])
    if np.ptp(t_s) < LEAST_TRACKLET_S:
        return None
    camera = network.cameras[key[0]]
    bearings = camera.bearings_enu(np.array([(ray.u_px, ray.v_px) for ray in rays]))
    sigma_rad = float(np.mean([ray.sigma_px for ray in rays])) / min(camera.lens.intrinsics[:2])
    if not np.all(np.isfinite(bearings)):
        return None
    mid_s = float(t_s.mean())
    design = np.vander(t_s - mid_s, degree + 1, increasing=True)
    curve = np.asarray(np.linalg.lstsq(design, bearings, rcond=None)[0], float)
    bend = np.linalg.norm(bearings - design @ curve, axis=1)
    if np.median(bend) > MAX_BEND * sigma_rad:
        return None
    return Tracklet(key[0], key[1], t_s, bearings, sigma_rad, mid_s, curve)


@dataclass(frozen=True)
class _Rays:
    """Rays of several tracklets: camera numbers (N,), centres (N, 3), bearings (N, 3), sigma (N,), times (N,)."""

    camera: Array
    centre: Array
    bearings: Array
    across: Array
    sigma_rad: Array
    after_s: Array


def flight(members: Sequence[Tracklet], network: Network, options: TrackerOptions, search: Search) -> NewTrack | None:
    """The flight through the members' rays, or None if there is none that could be a target."""
    if len(members) < 2:
        return None
    t_s = np.concatenate([member.t_s for member in members])
    mid_s = float(t_s.mean())
    rays = _rays(members, network, t_s - mid_s)
    path = _fit(rays, search, options.motion.sigma_m_s2)
    ahead = np.einsum("ni,ni->n", path.towards, rays.bearings) > options.limits.min_range_m
    if not (ahead.all() and path.misfit < MAX_FIT and path.range_m.max() < options.limits.max_range_m):
        return None
    covariance, with_poses = _covariance(path, _by_pose(rays, network, path.weight, path.range_m), network)
    if not could_be(path.state[3:6], covariance, options.limits.max_speed_m_s):
        return None
    seen_by = tuple((member.camera, member.label) for member in members)
    return NewTrack(path.state, covariance, with_poses, mid_s, seen_by)


def could_be(velocity_m_s: Array, covariance: Array, max_speed_m_s: float) -> bool:
    """Whether a speed is not beyond doubt above the greatest: of far objects it is known badly. covariance: (9, 9)."""
    sigma_m_s = float(np.sqrt(max(np.linalg.eigvalsh(covariance[3:6, 3:6])[-1], 0.0)))
    return float(np.linalg.norm(velocity_m_s)) - SPEED_SIGMAS * sigma_m_s < max_speed_m_s


@dataclass(frozen=True)
class _Path:
    """A fitted flight: state (9,) at the middle, normal matrix (9, 9), design (N, 2, 9), and how its rays lie to it."""

    state: Array
    normal: Array
    design: Array
    weight: Array
    towards: Array
    range_m: Array
    misfit: float


def _fit(rays: _Rays, search: Search, usual_m_s2: float) -> _Path:
    """Least squares over position, velocity and, where a turn is looked for, acceleration, about none."""
    after_s = rays.after_s
    sigma_m_s2 = search.sigma_m_s2 or usual_m_s2
    # What a straight flight's turn, or a turn's change, moves a ray by is noise.
    unknown = search.jerk_m_s3 * np.abs(after_s) ** 3 / 6 if search.sigma_m_s2 else usual_m_s2 * after_s**2 / 2
    turns = after_s**2 / 2 if search.sigma_m_s2 else np.zeros_like(after_s)
    steps = np.column_stack([np.ones_like(after_s), after_s, turns])
    prior = np.diag([0.0] * 6 + [sigma_m_s2**-2] * 3)
    across = np.einsum("nij,nk->nikj", rays.across, steps).reshape(len(after_s), 2, STATE)
    right = np.einsum("nij,nj->ni", rays.across, rays.centre)
    weight = np.ones(len(after_s))
    for _ in range(2):  # the ranges that weigh the rays come out of the first round
        design = across * weight[:, None, None]
        normal = np.einsum("nia,nib->ab", design, design) + prior
        state = np.linalg.lstsq(normal, np.einsum("nia,ni->a", design, right * weight[:, None]), rcond=None)[0]
        towards = np.einsum("nk,kj->nj", steps, state.reshape(3, 3)) - rays.centre
        range_m = np.linalg.norm(towards, axis=1)
        weight = 1 / np.sqrt((rays.sigma_rad * range_m) ** 2 + unknown**2 + SIGMA_FLOOR_M**2)
    residual = np.einsum("nij,nj->ni", rays.across, towards) * weight[:, None]
    misfit = (float(np.sum(residual**2)) + float(state @ prior @ state)) / max(2 * len(after_s) - 6, 1)
    return _Path(state, normal, design, weight, towards, range_m, misfit)


def _rays(members: Sequence[Tracklet], network: Network, after_s: Array) -> _Rays:
    bearings = np.concatenate([member.bearings for member in members])
    camera = np.concatenate([np.full(len(member.t_s), member.camera) for member in members])
    sigma = np.concatenate([np.full(len(member.t_s), bearing_sigma(member, network)) for member in members])
    centre = network.centres_enu[camera]
    return _Rays(camera, centre, bearings, _across(bearings), sigma, after_s)


def bearing_sigma(tracklet: Tracklet, network: Network) -> float:
    """One sigma, rad, of a tracklet's rays, the camera's attitude included."""
    at = attitude_of(tracklet.camera)
    attitude = np.trace(network.covariance[at, at]) / 3
    return float(np.hypot(tracklet.sigma_rad, np.sqrt(max(attitude, 0.0))))


def _by_pose(rays: _Rays, network: Network, weight: Array, range_m: Array) -> Array:
    """(N, 2, 6 C) derivative of the weighted residuals by all poses."""
    by_pose = np.zeros((len(weight), 2, POSE_SIZE * len(network.cameras)))
    for k, c in enumerate(rays.camera.astype(int)):
        turned = np.cross(network.cameras[c].R_cam_enu, rays.bearings[k]).T  # columns: the ray, turned about an axis
        by_rotation = rays.across[k] @ turned * (range_m[k] * weight[k])
        by_pose[k, :, pose_of(c)] = np.hstack([by_rotation, -rays.across[k] * weight[k]])
    return by_pose


def _covariance(path: _Path, by_pose: Array, network: Network) -> tuple[Array, Array]:
    """(9, 9) of the state and (9, 6 C) with the poses."""
    inverse = np.linalg.pinv(path.normal, hermitian=True)
    follows = -inverse @ np.einsum("nia,nib->ab", path.design, by_pose)
    return inverse + follows @ network.covariance @ follows.T, follows @ network.covariance


def _across(bearings: Array) -> Array:
    """(N, 2, 3) two unit vectors across each bearing."""
    helper = np.where(np.abs(bearings[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(bearings, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(bearings, first)], axis=1)
