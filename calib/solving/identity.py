"""Which track of one camera shows the same object as which track of another.

Two hazards. A bird that crosses the UAV's path: for a moment both explain the same rays. A match is therefore judged
over the whole time two tracks share, matches with most evidence are made first, and one camera's two tracks that run
at the same time are never the same object. And a track that is two objects, one after the other (cutting.py). Short
tracks among many are matched where chance can be excluded: by a third camera, or because there is no rival. Tracks that
match nothing (clutter, things one camera sees) are left out.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from calib.geometry.twoview import reprojection, triangulate
from calib.solving.agreement import (
    Bools,
    Gridded,
    TrackPair,
    compared,
    contested,
    grid_of,
    on_grid,
    several_at_once,
)
from calib.solving.cutting import cuts, pieces
from calib.solving.scaffold import Pose
from calib.solving.series import TrackSeries
from edge.common.arrays import Array

SHORTEST_COMMON_S: Final = 1.0  # two tracks that share less have had no time to disagree
FEWEST_COMMON: Final = 8  # instants, for the same reason
CONTESTED_SHARE: Final = 0.1  # of their common time, that two tracks of one object may seem to be of two
NO_CHANCE_S: Final = 5.0  # of common time, over which no chance lasts
CHANCE_RAY: Final = 0.3  # across which other things are spread in a picture: one is as near as r by chance 1 in 0.3 / r
UNLIKELY_MATCH: Final = 0.05  # chance of a match with something else, below which no third camera is asked
RIVAL_MISFIT: Final = 3.0  # times its misfit: another track that is nearly as good
CONTRADICTED_MISFIT: Final = 2.0  # times the threshold, at which two members of one group are not one object
Key = tuple[str, int]  # camera, track number


@dataclass(frozen=True)
class Identified:
    """objects: counted from 0, of every track that at least two cameras agree on. tracks: by camera, cut anew."""

    objects: dict[Key, int]
    tracks: dict[str, list[TrackSeries]]


@dataclass(frozen=True)
class _Match:
    misfit: float
    common_s: float
    one: int
    two: int


def identify(
    tracks: dict[str, list[TrackSeries]], offsets: dict[str, float], poses: dict[str, Pose], threshold_ray: float
) -> Identified:
    """Objects, and the tracks that they are made of.

    tracks by camera; offsets in seconds; poses of the cameras that have one, all in one frame.
    """
    posed = {name: tracks[name] for name in sorted(poses) if tracks[name]}
    if len(posed) < 2:
        return Identified({}, tracks)
    scene = _Scene(posed, offsets, poses, threshold_ray)
    if scene.several:
        scene.cut()
    objects = scene.objects()
    return Identified(objects, {**tracks, **scene.tracks()})


class _Scene:
    """All tracks on one grid, and what each two of them say of one another."""

    def __init__(
        self,
        tracks: dict[str, list[TrackSeries]],
        offsets: dict[str, float],
        poses: dict[str, Pose],
        threshold_ray: float,
    ) -> None:
        self._offsets, self._poses, self._threshold_ray = offsets, poses, threshold_ray
        self.several = any(map(several_at_once, tracks.values()))
        self._names = list(tracks)
        self._grid_s = grid_of(tracks, offsets)
        self._step_s = float(self._grid_s[1] - self._grid_s[0]) if len(self._grid_s) > 1 else 1.0
        self._all = [g for name, own in tracks.items() for g in on_grid(name, own, self._grid_s, offsets[name])]
        self._pairs = {
            (i, j): pair
            for i, j in combinations(range(len(self._all)), 2)
            if self._all[i].camera != self._all[j].camera and self._at_once(i, j)
            if (pair := compared(self._all[i], self._all[j], poses, threshold_ray))
        }

    def _span(self, index: int) -> tuple[float, float]:
        """Site times of a track's first and last row."""
        track, offset_s = self._all[index].track, self._offsets[self._all[index].camera]
        return float(track.t_s[0]) + offset_s, float(track.t_s[-1]) + offset_s

    def _at_once(self, i: int, j: int) -> bool:
        one, two = self._span(i), self._span(j)
        return one[0] < two[1] and two[0] < one[1]

    def cut(self) -> None:
        """Take tracks apart where they change their object."""
        at = cuts(self._all, self._pairs)
        if not at:
            return
        parts: list[Gridded] = []
        parent: list[int] = []
        highest = {name: max(g.track.number for g in self._all if g.camera == name) for name in self._names}
        for index, one in enumerate(self._all):
            made = pieces(one, at.get(index, []), self._grid_s, self._offsets[one.camera], highest[one.camera] + 1)
            highest[one.camera] += len(at[index]) + 1 if index in at else 0
            parts += made
            parent += [index] * len(made)
        seen = [part.seen for part in parts]
        pairs = {}
        for i, j in combinations(range(len(parts)), 2):
            pair = self._pairs.get((parent[i], parent[j]))
            if pair is not None and np.any(seen[i] & seen[j]):
                pairs[i, j] = pair.within(seen[i] & seen[j])
        self._all, self._pairs = parts, pairs

    def tracks(self) -> dict[str, list[TrackSeries]]:
        """By camera, longest first."""
        return {
            name: sorted(
                (g.track for g in self._all if g.camera == name), key=lambda track: (-track.duration_s, track.number)
            )
            for name in self._names
        }

    def objects(self) -> dict[Key, int]:
        """The object of every track that at least two cameras agree on."""
        groups: dict[int, set[int]] = {index: {index} for index in range(len(self._all))}
        for match in sorted(self._matches(), key=lambda m: m.misfit / m.common_s):
            one, two = groups[match.one], groups[match.two]
            if one is not two and not self._exclude(one, two):
                one |= two
                for index in two:
                    groups[index] = one
        shared = {id(g): g for g in groups.values() if len({self._all[k].camera for k in g}) >= 2}
        span_s = {k: float(np.diff(self._span(k))[0]) for g in shared.values() for k in g}
        ordered = sorted(shared.values(), key=lambda g: (-sum(span_s[k] for k in g), min(map(self._key, g))))
        return {self._key(index): number for number, group in enumerate(ordered) for index in group}

    def _key(self, index: int) -> Key:
        return self._all[index].camera, self._all[index].track.number

    def _exclude(self, one: set[int], two: set[int]) -> bool:
        """Whether two groups cannot be one object: seen twice at once by a camera, or plainly in two places."""
        for a in one:
            for b in two:
                if self._all[a].camera == self._all[b].camera:
                    if self._at_once(a, b):
                        return True
                elif self.several and (pair := self._pairs.get((min(a, b), max(a, b)))):
                    misfit = pair.misfit[np.isfinite(pair.misfit)]
                    if len(misfit) >= FEWEST_COMMON and np.median(misfit) > CONTRADICTED_MISFIT * self._threshold_ray:
                        return True
        return False

    def _matches(self) -> list[_Match]:
        against = self._contested()
        found = []
        for (i, j), pair in self._pairs.items():
            valid = np.flatnonzero(np.isfinite(pair.misfit))
            common_s = float(valid[-1] - valid[0]) * self._step_s if len(valid) else 0.0
            if len(valid) < min(FEWEST_COMMON, SHORTEST_COMMON_S / self._step_s) or common_s < SHORTEST_COMMON_S:
                continue
            misfit = float(np.median(pair.misfit[valid]))
            if misfit < self._threshold_ray and against[i, j].sum() <= CONTESTED_SHARE * len(valid):
                match = _Match(misfit, common_s, i, j)
                if not self.several or common_s > NO_CHANCE_S or self._no_chance(match, pair):
                    found.append(match)
        return found

    def _contested(self) -> dict[tuple[int, int], Bools]:
        found: dict[tuple[int, int], Bools] = {}
        for one, two in combinations(self._names, 2):
            own = {
                (i, j): pair
                for (i, j), pair in self._pairs.items()
                if {self._all[i].camera, self._all[j].camera} == {one, two}
            }
            found |= contested(own)
        return found

    def _no_chance(self, match: _Match, pair: TrackPair) -> bool:
        """Whether a short match is no accident: few other things are there, none as good, or a third camera agrees."""
        valid = np.isfinite(pair.misfit)
        others, rivals = 0, 0
        for (i, j), other in self._pairs.items():
            if len({i, j} & {match.one, match.two}) != 1 or self._cameras(i, j) != self._cameras(match.one, match.two):
                continue
            shared = other.misfit[valid & np.isfinite(other.misfit)]
            if 2 * len(shared) >= valid.sum():
                others += 1
                rivals += float(np.median(shared)) < max(self._threshold_ray / 2, RIVAL_MISFIT * match.misfit)
        alone = rivals == 0 and others * self._threshold_ray / CHANCE_RAY < UNLIKELY_MATCH
        return alone or self._third_agrees(match, valid)

    def _cameras(self, i: int, j: int) -> set[str]:
        return {self._all[i].camera, self._all[j].camera}

    def _third_agrees(self, match: _Match, valid: Bools) -> bool:
        """Whether a track of another camera shows the same points."""
        one, two = self._all[match.one], self._all[match.two]
        p, q = self._poses[one.camera], self._poses[two.camera]
        points = triangulate([one.rays[valid], two.rays[valid]], [p.R, q.R], [p.centre, q.centre])
        return any(
            self._shows(third, points, valid) for third in self._all if third.camera not in (one.camera, two.camera)
        )

    def _shows(self, third: Gridded, points: Array, valid: Bools) -> bool:
        at = third.seen[valid]
        if 2 * at.sum() < len(at):
            return False
        pose = self._poses[third.camera]
        off = reprojection(points[at], third.rays[valid][at], pose.R, pose.centre)
        return bool(np.median(off) < self._threshold_ray)
