"""The scaffold: two cameras whose relative pose is trusted enough to hang all others on.

The hazard is the twin. On a nearly planar flight a second essential matrix explains the pair as well as the true one,
with all points in front of both cameras; inlier counts and singular values do not tell them apart. A third camera does:
points that the wrong pose triangulates are bent, and no pose of a third camera explains them. So candidates from
several pairs are judged by how well the others resect into them, each pair in a scale of its own, never chained.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.errors import CalibrationError
from calib.geometry.resection import FEWEST_POINTS, Resection, resect
from calib.geometry.twoview import relative_poses, triangulate
from calib.solving.series import Common, TrackSeries, common, noise_ray
from edge.common.arrays import Array

PAIR_ROWS: Final = 400  # common rows a relative pose is found from
LENS_ERROR_RAY: Final = 0.006  # what a focal length 2 % off does at the middle of the image's half width
NOISE_SIGMAS: Final = 3.5  # of the tracks' own white noise
PAIRS_TRIED: Final = 6  # pairs with most common rows; a good scaffold is among the first two or three
GOOD_SHARE: Final = 0.85  # of the rows that a camera's pose explains: no need to look for a better scaffold
FAIR_SHARE: Final = 0.45  # below it a camera does not belong
SMALLEST_ANGLE_RAD: Final = 0.02  # rays that meet under less say little of the distance


@dataclass(frozen=True)
class Pose:
    """A camera in the scaffold's frame: R (3, 3) world to camera, centre (3,), and the share of rows it explains."""

    R: Array
    centre: Array
    share: float


@dataclass(frozen=True)
class Known:
    """Where objects were by the cameras that have a pose: site times (N,) in seconds from t_mid, points (N, 3), and
    which object each is of (N,).
    """

    t_s: Array
    points: Array
    target: NDArray[np.int64]


@dataclass(frozen=True)
class Scaffold:
    """Poses by camera in a frame of its own (the first of `pair` at the origin, their baseline 1).

    points: the flight in that frame as (t_s (N,), points (N, 3), target (N,): each combination of the pair's tracks).
    """

    pair: tuple[str, str]
    poses: dict[str, Pose]
    t_s: Array
    points: Array
    target: NDArray[np.int64]

    @property
    def known(self) -> Known:
        """The flight alone."""
        return Known(self.t_s, self.points, self.target)


def threshold_ray(tracks: list[list[TrackSeries]]) -> float:
    """How far in ray units an observation may be off before anything is refined."""
    noise = max((noise_ray(own) for own in tracks), default=0.0)
    return float(np.hypot(LENS_ERROR_RAY, NOISE_SIGMAS * noise))


def build(tracks: dict[str, list[TrackSeries]], offsets: dict[str, float]) -> Scaffold:
    """The best scaffold of all cameras that have an offset; tracks by camera, offsets in seconds.

    Raises CalibrationError if no two cameras see the same object long enough from different places.
    """
    names = sorted(offsets)
    shared = {
        (one, two): common(tracks[one], tracks[two], offsets[one], offsets[two], PAIR_ROWS)
        for one, two in combinations(names, 2)
    }
    ranked = sorted(shared, key=lambda pair: -_overlap(tracks, offsets, pair))[:PAIRS_TRIED]
    best: Scaffold | None = None
    for pair in ranked:
        for candidate in _candidates(pair, shared[pair], tracks, offsets):
            if best is None or _merit(candidate) > _merit(best):
                best = candidate
        if best and min(pose.share for pose in best.poses.values()) > GOOD_SHARE and len(best.poses) == len(names):
            break
    if best is None:
        raise CalibrationError(
            "no two cameras see the same object from different enough places",
            where=", ".join(names) or "no camera",
            action="fly where at least two cameras see it, for 20 s, with turns and changes of height",
        )
    return best


def _overlap(tracks: dict[str, list[TrackSeries]], offsets: dict[str, float], pair: tuple[str, str]) -> float:
    one, two = pair
    return float(
        sum(
            max(
                0.0,
                min(a.t_s[-1] + offsets[one], b.t_s[-1] + offsets[two])
                - max(a.t_s[0] + offsets[one], b.t_s[0] + offsets[two]),
            )
            for a in tracks[one]
            for b in tracks[two]
        )
    )


def _merit(scaffold: Scaffold) -> float:
    return sum(pose.share for pose in scaffold.poses.values())


def _candidates(
    pair: tuple[str, str], seen: Common, tracks: dict[str, list[TrackSeries]], offsets: dict[str, float]
) -> list[Scaffold]:
    threshold = threshold_ray([tracks[name] for name in pair])
    found = []
    combination = np.unique(np.column_stack([seen.track1, seen.track2]), axis=0, return_inverse=True)[1].reshape(-1)
    for pose in relative_poses(seen.rays1, seen.rays2, threshold, combination):
        centre = -pose.R.T @ pose.t
        points = triangulate([seen.rays1, seen.rays2], [np.eye(3), pose.R], [np.zeros(3), centre])
        steep = pose.inlier & (_angle(points, centre) > SMALLEST_ANGLE_RAD)
        if steep.sum() < 8:
            continue
        share = _share_of_tracks(seen, combination, pose.inlier)
        poses = {pair[0]: Pose(np.eye(3), np.zeros(3), share), pair[1]: Pose(pose.R, centre, share)}
        scaffold = Scaffold(pair, poses, seen.t_s[steep], points[steep], combination[steep])
        found.append(_with_others(scaffold, tracks, offsets))
    return found


def _angle(points: Array, centre: Array) -> Array:
    to_first, to_second = points, points - centre
    cosine = (to_first * to_second).sum(1)
    cosine /= np.linalg.norm(to_first, axis=1) * np.linalg.norm(to_second, axis=1)
    angle: Array = np.arccos(np.clip(cosine, -1, 1))
    return angle


def _with_others(scaffold: Scaffold, tracks: dict[str, list[TrackSeries]], offsets: dict[str, float]) -> Scaffold:
    poses = dict(scaffold.poses)
    for name in sorted(set(offsets) - set(poses)):
        pose = resect_camera(scaffold.known, tracks[name], offsets[name])
        if pose and pose.share >= FAIR_SHARE:
            poses[name] = pose
    return replace(scaffold, poses=poses)


def resect_camera(known: Known, tracks: list[TrackSeries], offset_s: float, fewest: int = FEWEST_POINTS) -> Pose | None:
    """Pose of one more camera against known points, every track of it a candidate for every object.

    fewest: points that its tracks must share with them.
    """
    points, rays, t_s, combination = matched(known, tracks, offset_s)
    enough = len(points) >= fewest
    found: Resection | None = resect(points, rays, threshold_ray([tracks]), combination) if enough else None
    if found is None:
        return None
    return Pose(found.R, found.centre, _share_of_instants(t_s, found.inlier))


def _share_of_tracks(seen: Common, combination: NDArray[np.int64], inlier: NDArray[np.bool_]) -> float:
    """Of the first camera's tracks, each taken for the one of the second's that fits most of its rows."""
    explained = np.bincount(combination, weights=inlier)
    rows = np.bincount(combination)
    first = np.zeros(len(rows), np.int64)
    first[combination] = seen.track1
    best = [max(np.flatnonzero(first == track), key=lambda at: explained[at]) for track in np.unique(seen.track1)]
    return float(explained[best].sum() / rows[best].sum())


def _share_of_instants(t_s: Array, inlier: NDArray[np.bool_]) -> float:
    """With several objects most combinations are wrong by construction: an instant counts once."""
    return len(np.unique(t_s[inlier])) / len(np.unique(t_s))


def matched(known: Known, tracks: list[TrackSeries], offset_s: float) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """The known points (M, 3) at which a camera's tracks run, their rays (M, 2) and times (M,), and which combination
    of a track and an object (M,) each is.
    """
    points, rays, instants, combination = [np.zeros((0, 3))], [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0, np.int64)]
    for index, track in enumerate(tracks):
        at = track.at(known.t_s - offset_s)
        good = np.isfinite(at[:, 0])
        points.append(known.points[good])
        rays.append(at[good])
        instants.append(known.t_s[good])
        combination.append(known.target[good] * len(tracks) + index)
    return np.concatenate(points), np.concatenate(rays), np.concatenate(instants), np.concatenate(combination)
