"""Which tracks of which cameras are of one object, in one slice of time, though one of the cameras may be wrong.

The hazard is the wrong partner: with twenty objects in each picture some ray always passes near, and a camera that was
knocked meets others where nothing is. So a point counts by how many cameras agree about it, the points that most agree
about choose their tracks first, and a camera that should see such a point and reports a track close by but not there
is put to it as a witness against, unless it agrees about another object at the same time.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.geometry.rays import LEAST_SINE2, nearest_point
from calib.guarding.looks import CameraLook
from calib.guarding.meetings import MATCH_SIGMA, NEAREST_M, median_low
from edge.common.arrays import Array

AGREE: Final = 3  # cameras about one point, before it is believed without looking further
LEAST_INSTANTS: Final = 3  # of a slice, that tracks must have in common
INSIDE_BY_PX: Final = 5.0
NEAR_RAD: Final = 0.06  # 3.4 degrees: what is farther from where it should be is another object


@dataclass(frozen=True)
class SeenObject:
    """Tracks taken for one object: members are camera numbers and the number of the track in its look.

    agree: (M,) which of them meet in the points (S, 3) ENU; the others pass by.
    """

    members: tuple[tuple[int, int], ...]
    agree: tuple[bool, ...]
    points: Array


@dataclass
class _Proposal:
    points: Array
    members: list[tuple[int, int]]
    miss: float
    due: int

    @property
    def rank(self) -> tuple[int, float]:
        return -len(self.members), self.miss


class Grouping:
    """Finds the objects of a slice, a pair of cameras at a time, for the loop's sake."""

    def __init__(self, looks: Sequence[CameraLook], pairs: Sequence[tuple[int, int]]) -> None:
        self._looks = looks
        self._pairs = pairs
        self._free = [np.ones(len(own), bool) for own in looks]
        self._waiting: list[_Proposal] = []
        self._found: list[_Proposal] = []

    def steps(self) -> Iterator[None]:
        """Go through the pairs; yields after each that took any time."""
        for pair in self._pairs:
            proposals = self._proposals(*pair)
            for proposal in sorted(proposals, key=lambda one: one.rank):
                count = len(proposal.members)
                if count >= AGREE and 2 * count > proposal.due and self._all_free(proposal):
                    self._take(proposal)
                else:
                    self._waiting.append(proposal)
            if proposals:
                yield
        for proposal in sorted(self._waiting, key=lambda one: one.rank):
            kept = [member for member in proposal.members if self._free[member[0]][member[1]]]
            if proposal.members[0] in kept and proposal.members[1] in kept:
                proposal.members = kept
                self._take(proposal)

    def _all_free(self, proposal: _Proposal) -> bool:
        return all(self._free[camera][track] for camera, track in proposal.members)

    def _take(self, proposal: _Proposal) -> None:
        for camera, track in proposal.members:
            self._free[camera][track] = False
        self._found.append(proposal)

    def objects(self) -> list[SeenObject]:
        """What was found: the objects that three cameras or more report, or should and report close by."""
        agreeing = {camera for one in self._found if len(one.members) >= AGREE for camera, _ in one.members}
        seen = []
        for one in sorted(self._found, key=lambda proposal: proposal.rank):
            astray = self._astray(one, agreeing)
            if len(one.members) + len(astray) >= AGREE:
                agree = (True,) * len(one.members) + (False,) * len(astray)
                seen.append(SeenObject((*one.members, *astray), agree, one.points))
        return seen

    def _astray(self, one: _Proposal, agreeing: set[int]) -> list[tuple[int, int]]:
        """Tracks close by, of cameras that should see this and agree about nothing else either."""
        found = []
        for camera in self._others([camera for camera, _ in one.members]):
            if camera in agreeing or not self._free[camera].any():
                continue
            own = self._looks[camera]
            miss_px, due = _misses(own, one.points[None])
            miss_px[~self._free[camera]] = np.inf
            track = int(np.argmin(miss_px[:, 0]))
            if due[0] and miss_px[track, 0] < NEAR_RAD * own.focal_px:
                self._free[camera][track] = False
                found.append((camera, track))
        return found

    def _others(self, cameras: Sequence[int]) -> list[int]:
        return [k for k, own in enumerate(self._looks) if k not in cameras and len(own)]

    def _proposals(self, a: int, b: int) -> list[_Proposal]:
        rows, columns = np.nonzero(self._free[a])[0], np.nonzero(self._free[b])[0]
        if not len(rows) or not len(columns):
            return []
        met = _meet(self._looks[a], self._looks[b], rows, columns)
        if not met:
            return []
        points = np.array([point for _, _, point, _, _ in met])
        sigma_m = np.array([sigma for _, _, _, sigma, _ in met])
        proposals = [_Proposal(point, [(a, row), (b, column)], miss, 2) for row, column, point, _, miss in met]
        for camera in self._others((a, b)):
            own = self._looks[camera]
            miss_px, due = _misses(own, points)
            miss_px[~self._free[camera]] = np.inf
            range_m = np.linalg.norm(median_low(np.moveaxis(points, 1, 2)) - own.view.camera.centre_enu, axis=1)
            allowed = np.hypot(own.allowed_px[:, None], own.focal_px * sigma_m / np.maximum(range_m, NEAREST_M))
            misses = miss_px / allowed
            nearest = np.argmin(misses, axis=0)
            for m, proposal in enumerate(proposals):
                proposal.due += bool(due[m])
                if misses[nearest[m], m] < MATCH_SIGMA:
                    proposal.members.append((camera, int(nearest[m])))
        return proposals


def _misses(own: CameraLook, points: Array) -> tuple[Array, NDArray[np.bool_]]:
    """How far (K, M) px each track is from where points (M, S, 3) should be seen, in the median; which are due (M,)."""
    shape = points.shape[:2]
    seen = own.view.sight(points.reshape(-1, 3))
    due = (seen.valid & own.view.inside(seen.pixels, INSIDE_BY_PX)).reshape(shape).all(axis=1)
    off = own.pixels[:, None] - seen.pixels.reshape(*shape, 2)[None]
    enough = np.isfinite(off[..., 0]).sum(axis=2) >= LEAST_INSTANTS
    median = median_low(np.moveaxis(off, 2, 3))
    miss: Array = np.where(enough & due, np.linalg.norm(median, axis=2), np.inf)
    return miss, due


def _meet(
    one: CameraLook, other: CameraLook, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> list[tuple[int, int, Array, float, float]]:
    """(row, column, points (S, 3), their sigma m, miss in sigmas) of tracks that meet."""
    a, b = one.bearings[rows][:, None], other.bearings[columns][None]
    near = nearest_point(one.view.camera.centre_enu, a, other.view.camera.centre_enu, b)
    steep = (near.sine2 > LEAST_SINE2) & (np.minimum(near.range_a_m, near.range_b_m) > NEAREST_M)
    enough = steep.sum(axis=2) >= LEAST_INSTANTS
    if not enough.any():
        return []
    angle_a = (one.allowed_px[rows] / one.focal_px)[:, None]
    angle_b = (other.allowed_px[columns] / other.focal_px)[None]
    sigma_m = np.hypot(
        angle_a * median_low(np.where(steep, near.range_a_m, np.nan)),
        angle_b * median_low(np.where(steep, near.range_b_m, np.nan)),
    )
    gap = median_low(np.where(steep, near.gap_m, np.nan))
    miss = np.where(enough, gap / sigma_m, np.inf)
    sine = np.sqrt(median_low(np.where(steep, near.sine2, np.nan)))
    found = []
    for row, column in zip(*np.nonzero(miss < MATCH_SIGMA), strict=True):
        points = _without_gaps(np.where(steep[row, column][:, None], near.points[row, column], np.nan))
        spread = float(sigma_m[row, column] / sine[row, column])
        found.append((int(rows[row]), int(columns[column]), points, spread, float(miss[row, column])))
    return found


def _without_gaps(points: Array) -> Array:
    """Points (S, 3) with missing ones replaced by their median."""
    return np.where(np.isfinite(points), points, median_low(points.T)[None])
