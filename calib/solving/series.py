"""A camera's tracks as functions of time: what two cameras saw at the same instant.

Cameras do not fire together, so before any geometry one camera's track has to be read at another's instants. The
hazard is to read it where nothing was seen: a straight line across a gap of half a second is an invention. And one
camera's track numbers mean nothing in another: which of its tracks shows the same object is a question for geometry,
so here every combination is a candidate.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.solving.numbering import on_a_path
from edge.common.arrays import Array

LONGEST_BRIDGE_S: Final = 0.25  # a track is read between two of its rows no further apart: a UAV turns in longer
SLOW_CAMERA: Final = 2.5  # times its own interval a camera of few frames a second may miss
SHORTEST_TRACK: Final = 10  # rows: fewer say nothing of a path
MOST_TRACKS: Final = 40  # the longest are kept: every pair of two cameras' tracks is tried


@dataclass(frozen=True)
class TrackSeries:
    """One track of one camera: t_s (N,) seconds from t_mid, increasing; rays (N, 2); row (N,) in the observations."""

    number: int
    t_s: Array
    rays: Array
    row: NDArray[np.int64]

    @cached_property
    def longest_bridge_s(self) -> float:
        """How far apart two rows may be to read the track between them: a slow camera's rows always are."""
        return max(LONGEST_BRIDGE_S, SLOW_CAMERA * float(np.median(np.diff(self.t_s))))

    @property
    def duration_s(self) -> float:
        """From first to last row."""
        return float(self.t_s[-1] - self.t_s[0])

    def stretched(self, rate: float) -> "TrackSeries":
        """The same with its stamps at another pace: t (1 + rate)."""
        return replace(self, t_s=self.t_s * (1 + rate)) if rate else self

    def later(self, by_s: float) -> "TrackSeries":
        """The same with its stamps so much later."""
        return replace(self, t_s=self.t_s + by_s) if by_s else self

    def rows(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> "TrackSeries":
        """Only some of its rows: a mask (N,) or indices."""
        return replace(self, t_s=self.t_s[which], rays=self.rays[which], row=self.row[which])

    def at(self, t_s: Array) -> Array:
        """Rays (M, 2) at stamped times (M,), interpolated; NaN where no two rows enclose the time closely."""
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        before = after - 1
        gap = self.t_s[after] - self.t_s[before]
        share = (t_s - self.t_s[before]) / gap
        rays = self.rays[before] + share[:, None] * (self.rays[after] - self.rays[before])
        enclosed = (gap <= self.longest_bridge_s) & (share >= 0) & (share <= 1)
        return np.where(enclosed[:, None], rays, np.nan)


def split_tracks(t_s: Array, rays: Array, label: NDArray[np.int64]) -> list[TrackSeries]:
    """A camera's tracks, longest first; rows without a ray or a label (< 0) and repeated stamps are left out.

    t_s: (N,) in time order; rays: (N, 2), NaN where there is none; label: (N,) which rows belong together.
    """
    tracks = []
    usable = np.flatnonzero(np.isfinite(rays[:, 0]) & (label >= 0))
    order = usable[np.argsort(label[usable], kind="stable")]
    for own in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        if len(own) < SHORTEST_TRACK:
            continue
        once = own[np.concatenate([[True], np.diff(t_s[own]) > 0])]
        row = once[on_a_path(rays[once])]
        if len(row) >= SHORTEST_TRACK:
            tracks.append(TrackSeries(int(label[row[0]]), t_s[row], rays[row], row))
    tracks.sort(key=lambda track: (-track.duration_s, track.number))
    return tracks[:MOST_TRACKS]


def noise_ray(tracks: list[TrackSeries]) -> float:
    """One sigma a coordinate of the white part of the noise, ray units, from the tracks' third differences."""
    parts = []
    for track in tracks:
        third = np.diff(track.rays, n=3, axis=0)
        regular = np.ptp(np.lib.stride_tricks.sliding_window_view(np.diff(track.t_s), 3), axis=1) < 2e-3
        parts.append(np.abs(third[regular]).ravel())
    values = np.concatenate(parts) if parts else np.zeros(0)
    return float(np.median(values) / 0.6745 / np.sqrt(20)) if len(values) else 0.0  # 1 + 9 + 9 + 1 = 20


def gap_to_nearest_s(t_s: Array, others: Array) -> Array:
    """(N,) seconds from each time to the nearest of the others (M,), which are in order; infinite if there are none."""
    if len(others) == 0:
        return np.full(len(t_s), np.inf)
    after = np.clip(np.searchsorted(others, t_s), 0, len(others) - 1)
    before = np.maximum(after - 1, 0)
    gap: Array = np.minimum(np.abs(others[after] - t_s), np.abs(t_s - others[before]))
    return gap


def even(count: int, most: int) -> NDArray[np.int64]:
    """Indices of at most `most` of `count` things, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


@dataclass(frozen=True)
class Common:
    """What two cameras saw at the same site times: t_s (N,), rays1, rays2 (N, 2), and which tracks (N,) of each."""

    t_s: Array
    rays1: Array
    rays2: Array
    track1: NDArray[np.int64]
    track2: NDArray[np.int64]


def common(
    first: list[TrackSeries], second: list[TrackSeries], offset1_s: float, offset2_s: float, most: int
) -> Common:
    """Every combination of a track of the first camera and one of the second, at the first's instants.

    offsets: what to add to each camera's stamps to get site time. At most `most` rows, evenly spread in time.
    """
    rows = []
    for i, one in enumerate(first):
        for j, two in enumerate(second):
            site = one.t_s + offset1_s
            rays = two.at(site - offset2_s)
            good = np.isfinite(rays[:, 0])
            if good.sum() >= SHORTEST_TRACK:
                n = int(good.sum())
                rows.append((site[good], one.rays[good], rays[good], np.full(n, i), np.full(n, j)))
    if not rows:
        empty, none = np.zeros((0, 2)), np.zeros(0, np.int64)
        return Common(np.zeros(0), empty, empty, none, none)
    t, r1, r2, k1, k2 = (np.concatenate(part) for part in zip(*rows, strict=True))
    order = np.argsort(t, kind="stable")
    keep = order[even(len(order), most)]
    return Common(t[keep], r1[keep], r2[keep], k1[keep], k2[keep])
