"""Short tracks of one camera, and the straight flights that several of them may be.

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
from calib.tracking.motion import STATE, Singer
from calib.tracking.options import Limits
from edge.common.arrays import Array

MIN_RAYS: Final = 3  # a line in time through two rays always fits
LEAST_TRACKLET_S: Final = 0.06  # s: two frames at 30 Hz; less says nothing of motion
FRESH_S: Final = 0.4  # s since a track's last ray; older ones no longer tell where the object is
MAX_BEND: Final = 6.0  # sigma, median: a hard turn bends a track by less, a number given to another object by more
MAX_FIT: Final = 3.0  # mean squared normalised residual: 1 for a true target, much more for a ghost
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

    t_s: (N,); bearings: (N, 3) unit ENU; sigma_rad; line: (2, 3) the bearing at mid_s and its rate per second.
    """

    camera: int
    label: int
    t_s: Array
    bearings: Array
    sigma_rad: float
    mid_s: float
    line: Array

    def at(self, t_s: float) -> Array:
        """(3,) bearing at a time near its own."""
        bearing: Array = self.line[0] + self.line[1] * (t_s - self.mid_s)
        return bearing / np.linalg.norm(bearing)


@dataclass(frozen=True)
class NewTrack:
    """A tentative target: state (9,), covariance (9, 9), with the poses (9, 6 C), time; who saw it (camera, label)."""

    state: Array
    covariance: Array
    with_poses: Array
    t_s: float
    seen_by: tuple[tuple[int, int], ...]


def tracklets(rays: Iterable[LooseRay], network: Network, now_s: float) -> list[Tracklet]:
    """The short tracks among loose rays: long, fresh and straight enough."""
    groups: defaultdict[tuple[int, int], list[LooseRay]] = defaultdict(list)
    for ray in rays:
        groups[ray.camera, ray.label].append(ray)
    made = (_tracklet(key, group, network, now_s) for key, group in groups.items() if len(group) >= MIN_RAYS)
    return [tracklet for tracklet in made if tracklet is not None]


def _tracklet(key: tuple[int, int], rays: list[LooseRay], network: Network, now_s: float) -> Tracklet | None:
    t_s = np.array([ray.t_s for ray in rays])
    if t_s.max() < now_s - FRESH_S or np.ptp(t_s) < LEAST_TRACKLET_S:
        return None
    camera = network.cameras[key[0]]
    bearings = camera.bearings_enu(np.array([(ray.u_px, ray.v_px) for ray in rays]))
    sigma_rad = float(np.mean([ray.sigma_px for ray in rays])) / min(camera.lens.intrinsics[:2])
    if not np.all(np.isfinite(bearings)):
        return None
    mid_s = float(t_s.mean())
    design = np.column_stack([np.ones_like(t_s), t_s - mid_s])
    line = np.linalg.lstsq(design, bearings, rcond=None)[0]
    bend = np.linalg.norm(bearings - design @ line, axis=1)
    if np.median(bend) > MAX_BEND * sigma_rad:
        return None
    return Tracklet(key[0], key[1], t_s, bearings, sigma_rad, mid_s, line)


@dataclass(frozen=True)
class _Rays:
    """Rays of several tracklets: camera numbers (N,), centres (N, 3), bearings (N, 3), sigma (N,), times (N,)."""

    camera: Array
    centre: Array
    bearings: Array
    across: Array
    sigma_rad: Array
    after_s: Array


def straight_flight(members: Sequence[Tracklet], network: Network, motion: Singer, limits: Limits) -> NewTrack | None:
    """The straight flight through the members' rays, or None if there is none that could be a target."""
    if len(members) < 2:
        return None
    t_s = np.concatenate([member.t_s for member in members])
    mid_s = float(t_s.mean())
    rays = _rays(members, network, t_s - mid_s)
    weight = np.ones(len(t_s))
    for _ in range(2):  # the ranges that weigh the rays come out of the first round
        design = np.concatenate([rays.across, rays.across * rays.after_s[:, None, None]], axis=2)
        design *= weight[:, None, None]
        right = np.einsum("nij,nj->ni", rays.across, rays.centre) * weight[:, None]
        normal = np.einsum("nia,nib->ab", design, design)
        flight = np.linalg.lstsq(normal, np.einsum("nia,ni->a", design, right), rcond=None)[0]
        towards = flight[:3] + flight[3:] * rays.after_s[:, None] - rays.centre
        range_m = np.linalg.norm(towards, axis=1)
        turn_m = motion.sigma_m_s2 * rays.after_s**2 / 2
        weight = 1 / np.sqrt((rays.sigma_rad * range_m) ** 2 + turn_m**2 + SIGMA_FLOOR_M**2)
    residual = np.einsum("nij,nj->ni", rays.across, towards) * weight[:, None]
    ahead = np.einsum("ni,ni->n", towards, rays.bearings) > limits.min_range_m
    fit = float(np.sum(residual**2)) / max(2 * len(t_s) - 6, 1)
    slow = np.linalg.norm(flight[3:]) < limits.max_speed_m_s
    if not (ahead.all() and slow and fit < MAX_FIT and range_m.max() < limits.max_range_m):
        return None
    by_pose = _by_pose(rays, network, weight, range_m)
    covariance, with_poses = _covariance(design, by_pose, network, motion)
    seen_by = tuple((member.camera, member.label) for member in members)
    return NewTrack(np.concatenate([flight, np.zeros(3)]), covariance, with_poses, mid_s, seen_by)


def _rays(members: Sequence[Tracklet], network: Network, after_s: Array) -> _Rays:
    bearings = np.concatenate([member.bearings for member in members])
    camera = np.concatenate([np.full(len(member.t_s), member.camera) for member in members])
    sigma = np.concatenate([np.full(len(member.t_s), bearing_sigma(member, network)) for member in members])
    centre = np.array([c.centre_enu for c in network.cameras])[camera]
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


def _covariance(design: Array, by_pose: Array, network: Network, motion: Singer) -> tuple[Array, Array]:
    """(9, 9) of the state and (9, 6 C) with the poses."""
    inverse = np.linalg.pinv(np.einsum("nia,nib->ab", design, design), hermitian=True)
    follows = -inverse @ np.einsum("nia,nib->ab", design, by_pose)
    covariance = np.zeros((STATE, STATE))
    covariance[:6, :6] = inverse + follows @ network.covariance @ follows.T
    covariance[6:, 6:] = np.eye(3) * motion.sigma_m_s2**2
    return covariance, np.vstack([follows @ network.covariance, np.zeros((3, by_pose.shape[2]))])


def _across(bearings: Array) -> Array:
    """(N, 2, 3) two unit vectors across each bearing."""
    helper = np.where(np.abs(bearings[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(bearings, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(bearings, first)], axis=1)
