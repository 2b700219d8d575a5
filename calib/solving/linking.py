"""Rows of one camera linked to tracks by their motion alone: nearest to where each was going, frame by frame.

The hazard is the silent exchange. Where two objects meet in the picture, or one is lost and another is near, no motion
tells which is which; a link made there is a guess, and everything after it is wrong. So where two links are about as
good as their exchange, none is made: both tracks end, new ones begin, and geometry says later what belongs together.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from edge.common.arrays import Array

LONGEST_LOSS_S: Final = 0.6  # a track goes on across so long a gap, and across LOST_FRAMES of a slow camera
LOST_FRAMES: Final = 4
GATE_RAY: Final = 0.012  # around where a track is expected: what noise and a turn between two frames make
TURN_RAY_S2: Final = 0.15  # 15 m/s^2 at 100 m
NEW_RAY_S: Final = 0.5  # a track of one row may go anywhere: 50 m/s at 100 m
UNSURE_GATES: Final = 2.0  # times the gate of two links, that their exchange may cost more and still be as good
VELOCITY_ROWS: Final = 4  # rows that a velocity is taken from


@dataclass
class _Trail:
    """A track that is being followed."""

    label: int
    t_s: list[float] = field(default_factory=list)
    rays: list[tuple[float, float]] = field(default_factory=list)

    def add(self, t_s: float, ray: tuple[float, float]) -> None:
        self.t_s.append(t_s)
        self.rays.append(ray)
        del self.t_s[:-VELOCITY_ROWS], self.rays[:-VELOCITY_ROWS]

    def expected(self, t_s: float) -> tuple[float, float, float]:
        """Ray (x, y) at a time, and how far around it."""
        (x, y), ahead_s = self.rays[-1], t_s - self.t_s[-1]
        if len(self.t_s) == 1:
            return x, y, GATE_RAY + NEW_RAY_S * ahead_s
        over_s = self.t_s[-1] - self.t_s[0]
        vx, vy = (x - self.rays[0][0]) / over_s, (y - self.rays[0][1]) / over_s
        # A velocity of few rows is good to their noise over their time; what turns, turns more in longer.
        spread = GATE_RAY * (1 + ahead_s / over_s) + 0.5 * TURN_RAY_S2 * ahead_s * (ahead_s + over_s)
        return x + vx * ahead_s, y + vy * ahead_s, spread


def link(t_s: Array, rays: Array) -> NDArray[np.int64]:
    """Track labels (N,) of rows at t_s (N,) in time order, rays (N, 2) finite."""
    label = np.empty(len(t_s), np.int64)
    frame_s, start = np.unique(t_s, return_index=True)
    ends = np.append(start[1:], len(t_s))
    lost_s = max(LONGEST_LOSS_S, LOST_FRAMES * float(np.median(np.diff(frame_s)))) if len(frame_s) > 1 else 0.0
    trails: list[_Trail] = []
    count = 0
    points = [(float(x), float(y)) for x, y in rays.tolist()]
    for now, first, end in zip(frame_s.tolist(), start.tolist(), ends.tolist(), strict=True):
        trails = [trail for trail in trails if now - trail.t_s[-1] <= lost_s]
        taken, ended = _links(trails, points[first:end], now)
        trails = [trail for k, trail in enumerate(trails) if k not in ended]
        for row in range(first, end):
            trail = taken.get(row - first)
            if trail is None:
                trail = _Trail(count)
                trails.append(trail)
                count += 1
            trail.add(now, points[row])
            label[row] = trail.label
    return label


def _links(trails: list[_Trail], points: list[tuple[float, float]], now_s: float) -> tuple[dict[int, _Trail], set[int]]:
    """Which trail each row goes on with, and which trails end because nobody can tell."""
    if not trails:
        return {}, set()
    expected = np.array([trail.expected(now_s) for trail in trails])
    off = np.linalg.norm(np.array(points)[None] - expected[:, None, :2], axis=2)
    gate = expected[:, 2:]
    cost = np.minimum(off / gate, 1.0)
    rows, columns = linear_sum_assignment(cost)
    chosen = {int(i): int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < 1.0}
    ended = _undecided(off, gate, chosen)
    return {j: trails[i] for i, j in chosen.items() if i not in ended}, ended


def _undecided(off: Array, gate: Array, chosen: dict[int, int]) -> set[int]:
    """Trails whose row another trail might claim as well."""
    ended: set[int] = set()
    for i, j in chosen.items():
        for other in np.flatnonzero(off[:, j] < gate[:, 0]).tolist():
            if other != i and _as_good(off, chosen, i, other):
                ended |= {i, other}
    return ended


def _as_good(off: Array, chosen: dict[int, int], one: int, other: int) -> bool:
    """Whether one trail's row might as well be the other's, which takes the first one's row or loses its own."""
    own, theirs = chosen[one], chosen.get(other)
    if theirs is None:
        return bool(off[other, own] < off[one, own] + GATE_RAY)
    return bool(off[one, theirs] + off[other, own] < off[one, own] + off[other, theirs] + UNSURE_GATES * GATE_RAY)
