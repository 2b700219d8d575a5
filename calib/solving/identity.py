"""Which track of one camera shows the same object as which track of another.

The hazard is a bird that crosses the UAV's path: for a moment both explain the same rays. A match is therefore judged
over the whole time two tracks share, matches with most evidence are made first, and one camera's two tracks that run
at the same time are never the same object. Tracks that match nothing (clutter, things one camera sees) are left out.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from calib.geometry.twoview import reprojection, triangulate
from calib.solving.scaffold import Pose
from calib.solving.series import SHORTEST_TRACK, TrackSeries, common

COMPARED_ROWS: Final = 80  # common rows two tracks are compared at
SHORTEST_COMMON_S: Final = 1.0  # two tracks that share less have had no time to disagree
Key = tuple[str, int]  # camera, track number


@dataclass(frozen=True)
class _Match:
    misfit: float
    common_s: float
    one: Key
    two: Key


def identify(
    tracks: dict[str, list[TrackSeries]], offsets: dict[str, float], poses: dict[str, Pose], threshold_ray: float
) -> dict[Key, int]:
    """The object, counted from 0, of every track that at least two cameras agree on.

    tracks by camera; offsets in seconds; poses of the cameras that have one, all in one frame.
    """
    spans = {
        (name, track.number): (track.t_s[0] + offsets[name], track.t_s[-1] + offsets[name])
        for name in poses
        for track in tracks[name]
    }
    groups: dict[Key, set[Key]] = {key: {key} for key in spans}
    for match in sorted(_matches(tracks, offsets, poses, threshold_ray), key=lambda m: m.misfit / m.common_s):
        one, two = groups[match.one], groups[match.two]
        if one is not two and not _at_once(one, two, spans):
            one |= two
            for key in two:
                groups[key] = one
    shared = {id(group): group for group in groups.values() if len({name for name, _ in group}) >= 2}
    ordered = sorted(shared.values(), key=lambda group: (-sum(spans[k][1] - spans[k][0] for k in group), min(group)))
    return {key: index for index, group in enumerate(ordered) for key in group}


def _at_once(one: set[Key], two: set[Key], spans: dict[Key, tuple[float, float]]) -> bool:
    return any(a[0] == b[0] and spans[a][0] < spans[b][1] and spans[b][0] < spans[a][1] for a in one for b in two)


def _matches(
    tracks: dict[str, list[TrackSeries]], offsets: dict[str, float], poses: dict[str, Pose], threshold_ray: float
) -> list[_Match]:
    found = []
    for one, two in combinations(sorted(poses), 2):
        for a in tracks[one]:
            for b in tracks[two]:
                seen = common([a], [b], offsets[one], offsets[two], COMPARED_ROWS)
                if len(seen.t_s) < SHORTEST_TRACK or np.ptp(seen.t_s) < SHORTEST_COMMON_S:
                    continue
                p, q = poses[one], poses[two]
                points = triangulate([seen.rays1, seen.rays2], [p.R, q.R], [p.centre, q.centre])
                off = np.maximum(
                    reprojection(points, seen.rays1, p.R, p.centre), reprojection(points, seen.rays2, q.R, q.centre)
                )
                misfit = float(np.median(off))
                if misfit < threshold_ray:
                    found.append(_Match(misfit, float(np.ptp(seen.t_s)), (one, a.number), (two, b.number)))
    return found
