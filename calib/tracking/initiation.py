"""Track initiation: new, tentative targets from rays that were associated with none.

The hazard is the ghost. Rays of two different objects meet somewhere too, and with twenty objects in the air hundreds
of pairs of rays meet at any instant. A ghost gives itself away by the third camera, which sees nothing there, and by
time: two objects seldom move so that their rays go on meeting. So rays are first gathered to short tracks per camera,
pairs of tracks must meet at both ends of their common time, what most cameras support comes first, each track serves
one new target only, and that is no more than tentative.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.geometry.rays import LEAST_SINE2, nearest_point
from calib.network import Network
from calib.tracking.options import Limits, TrackerOptions
from calib.tracking.searches import Search
from calib.tracking.tracklets import SIGMA_FLOOR_M, NewTrack, Tracklet, bearing_sigma, flight
from edge.common.arrays import Array

MEET_SIGMA: Final = 4.0  # one sigma of two rays' distance, that they may miss each other by
MOST_INITIATED: Final = 8  # a scan: the rest come a tenth of a second later, and the loop never waits


def initiate(
    found: list[Tracklet], network: Network, options: TrackerOptions, search: Search, now_s: float
) -> list[NewTrack]:
    """Tentative targets from tracklets, best supported first."""
    if len({tracklet.camera for tracklet in found}) < 2:
        return []
    scan = _Scan(found, network, options.limits, (now_s - search.span_s / 2, search.span_s / 2))
    initiated: list[NewTrack] = []
    used: set[int] = set()
    for members in scan.candidates():
        if used.isdisjoint(members[:2]) and len(initiated) < MOST_INITIATED:
            free = [member for member in members if member not in used]
            track = flight([found[k] for k in free], network, options, search)
            if track is not None:
                initiated.append(track)
                used.update(free)
    return initiated


class _Scan:
    """All pairs of tracklets at two instants, and which further tracklets support each pair."""

    def __init__(self, found: list[Tracklet], network: Network, limits: Limits, about_s: tuple[float, float]) -> None:
        self._found, self._limits = found, limits
        self._camera = np.array([tracklet.camera for tracklet in found])
        self._centre = network.centres_enu[self._camera]
        self._sigma = np.array([bearing_sigma(tracklet, network) for tracklet in found])
        mid_s, self._between_s = about_s
        early, late = mid_s - self._between_s / 2, mid_s + self._between_s / 2
        self._early = np.array([tracklet.at(early) for tracklet in found])
        self._late = np.array([tracklet.at(late) for tracklet in found])

    def candidates(self) -> list[list[int]]:
        """Sets of tracklets that may be one object: a pair that meets, and its supporters; best first."""
        first, second = np.nonzero(self._camera[:, None] < self._camera[None, :])
        miss_early, point_early = self._meet(first, second, self._early)
        miss_late, point_late = self._meet(first, second, self._late)
        speed = np.linalg.norm(point_late - point_early, axis=1) / self._between_s
        miss = np.hypot(miss_early, miss_late)
        good = (miss_early < MEET_SIGMA) & (miss_late < MEET_SIGMA) & (speed < 2 * self._limits.max_speed_m_s)
        pairs = np.nonzero(good)[0]
        sets = [self._with_support(first[k], second[k], point_early[k], point_late[k]) for k in pairs]
        order = sorted(range(len(pairs)), key=lambda k: (-len(sets[k]), miss[pairs[k]]))
        return [sets[k] for k in order]

    def _meet(self, first: NDArray[np.int64], second: NDArray[np.int64], bearings: Array) -> tuple[Array, Array]:
        """By how many sigma pairs of rays miss each other (inf where they do not meet), and where they meet."""
        near = nearest_point(self._centre[first], bearings[first], self._centre[second], bearings[second])
        range_a, range_b = near.range_a_m, near.range_b_m
        sigma = np.sqrt((self._sigma[first] * range_a) ** 2 + (self._sigma[second] * range_b) ** 2 + SIGMA_FLOOR_M**2)
        nearest, farthest = np.minimum(range_a, range_b), np.maximum(range_a, range_b)
        possible = (nearest > self._limits.min_range_m) & (farthest < self._limits.max_range_m)
        return np.where(possible & (near.sine2 > LEAST_SINE2), near.gap_m / sigma, np.inf), near.points

    def _with_support(self, first: int, second: int, early: Array, late: Array) -> list[int]:
        """The pair and, from every other camera, the tracklet that comes nearest, if near enough."""
        off = np.zeros(len(self._found))
        for point, bearings in ((early, self._early), (late, self._late)):
            towards = point - self._centre
            range_m = np.linalg.norm(towards, axis=1)
            angle = np.linalg.norm(towards / range_m[:, None] - bearings, axis=1)
            # The pair's own point is uncertain by about as much as a ray of the pair at its range.
            slack = np.hypot(self._sigma, 2 * SIGMA_FLOOR_M / range_m) * 3
            off = np.maximum(off, angle / slack)
        off[(self._camera == self._camera[first]) | (self._camera == self._camera[second])] = np.inf
        members = [int(first), int(second)]
        for camera in np.unique(self._camera[off < MEET_SIGMA]):
            of_camera = np.nonzero(self._camera == camera)[0]
            members.append(int(of_camera[np.argmin(off[of_camera])]))
        return members
