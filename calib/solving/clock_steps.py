"""Clocks that do not run evenly: a box that was restarted or set in the middle of the flight, frames lost uncounted.

The hazard is the clock that is right on the average: half of the flight is read at the wrong time, no offset fits, and
pose and lens take the blame; or a small step fits well enough and bends everything. So a track that no steady clock
explains as well as it should is cut into pieces, each is placed in time by itself against cameras whose clocks are
known, and what the pieces say is read: a line is a rate, one jump a step, anything else a clock that is not steady.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.solving.clock_consensus import Clock, placed
from calib.solving.clocks import Alignment, align, chain
from calib.solving.series import SHORTEST_TRACK, TrackSeries
from edge.common.arrays import Array

PIECE_S: Final = 20.0  # of a track: the shortest that a few cameras together can place
MOST_PIECES: Final = 12  # of a longer flight: a step is named to a second by what comes after
LARGEST_STEP_S: Final = 5.0  # that is looked for: a restart takes as long; after a longer one nothing is sought
STEADY_S: Final = 0.06  # a piece is placed to a few hundredths
BIN_S: Final = 0.5  # rows that are judged together when a step is located


@dataclass(frozen=True)
class Stretch:
    """Stamps from_s to to_s (seconds from t_mid) during which a camera kept one clock."""

    from_s: float
    to_s: float
    clock: Clock


@dataclass(frozen=True)
class Steadiness:
    """What the pieces of a track say. stretches: in order, each with one clock; none: nothing can be said.

    unsteady: the pieces agree on nothing.
    """

    stretches: tuple[Stretch, ...] = ()
    unsteady: bool = False

    @property
    def longest(self) -> Stretch:
        """The stretch that the camera kept one clock for longest."""
        return max(self.stretches, key=lambda one: one.to_s - one.from_s)


def steadiness(
    tracks: list[TrackSeries], about: Clock, partners: dict[str, tuple[list[TrackSeries], Clock]]
) -> Steadiness:
    """Place the pieces of a camera's tracks by partners whose clocks are known. about: roughly where its own is."""
    whole = chain(tracks)
    pieces = _pieces(whole)
    found = [clock for piece in pieces if (clock := _placed(piece, about, partners)) is not None]
    if len(found) < 2:
        return Steadiness()
    line = _line(found)
    if line is not None:
        return Steadiness((Stretch(float(whole.t_s[0]), float(whole.t_s[-1]), line),))
    runs = [run for run in _runs(found) if len(run) > 1 or len(found) == 2]
    if len(runs) != 2 and not (len(runs) == 1 and len(runs[0]) >= len(found) - 1):
        return Steadiness(unsteady=True)
    if len(runs) == 1:
        return Steadiness(unsteady=True)
    return Steadiness(_stepped(whole, runs, partners))


@dataclass(frozen=True)
class _Piece:
    from_s: float
    to_s: float
    clock: Clock

    @property
    def middle_s(self) -> float:
        return (self.from_s + self.to_s) / 2

    @property
    def shift_s(self) -> float:
        return self.clock.site(self.middle_s) - self.middle_s


def _pieces(track: TrackSeries) -> list[TrackSeries]:
    count = int(np.clip(track.duration_s // PIECE_S, 1, MOST_PIECES))
    edges = np.linspace(track.t_s[0], track.t_s[-1], count + 1)
    cut = [(track.t_s >= start) & (track.t_s < end) for start, end in zip(edges[:-1], edges[1:], strict=True)]
    return [_rows(track, own) for own in cut if own.sum() >= SHORTEST_TRACK]


def _rows(track: TrackSeries, which: NDArray[np.bool_]) -> TrackSeries:
    return TrackSeries(track.number, track.t_s[which], track.rays[which], track.row[which])


def _placed(piece: TrackSeries, about: Clock, partners: dict[str, tuple[list[TrackSeries], Clock]]) -> _Piece | None:
    """Where a piece lies in time, if that is certain. Its stamps are taken to be near the site's first."""
    moved = TrackSeries(piece.number, about.offset_s + piece.t_s * (1 + about.rate), piece.rays, piece.row)
    said: dict[str, Alignment] = {}
    for name, (own, clock) in partners.items():
        there = [track.stretched(clock.rate).later(clock.offset_s) for track in own]
        said[name] = align(there, [moved], LARGEST_STEP_S)
    tied = placed({name: own.candidates for name, own in said.items()}, dict.fromkeys(said, Clock()), LARGEST_STEP_S)
    if tied is None or not tied.certain:
        return None
    rate = (1 + tied.clock.rate) * (1 + about.rate) - 1
    clock = Clock(about.offset_s * (1 + tied.clock.rate) + tied.clock.offset_s, rate)
    return _Piece(float(piece.t_s[0]), float(piece.t_s[-1]), clock)


def _line(pieces: list[_Piece]) -> Clock | None:
    """The steady clock on which all pieces lie, if there is one; two pieces are no line unless they are one clock."""
    t, shift = np.array([one.middle_s for one in pieces]), np.array([one.shift_s for one in pieces])
    if np.ptp(shift) <= STEADY_S:
        return Clock(float(np.median(shift)), 0.0)
    if len(pieces) < 3:
        return None
    rate, offset = np.polyfit(t, shift, 1)
    return Clock(float(offset), float(rate)) if np.abs(offset + rate * t - shift).max() <= STEADY_S else None


def _runs(pieces: list[_Piece]) -> list[list[_Piece]]:
    """Neighbours that keep one clock."""
    runs = [[pieces[0]]]
    for piece in pieces[1:]:
        if abs(piece.shift_s - runs[-1][-1].shift_s) <= STEADY_S:
            runs[-1].append(piece)
        else:
            runs.append([piece])
    return runs


def _stepped(
    track: TrackSeries, runs: list[list[_Piece]], partners: dict[str, tuple[list[TrackSeries], Clock]]
) -> tuple[Stretch, ...]:
    before, after = (Clock(float(np.median([one.shift_s for one in run])), 0.0) for run in runs)
    low, high = runs[0][-1].to_s, runs[1][0].from_s
    at = _located(track, (before, runs[0]), (after, runs[1]), (min(low, high), max(low, high)), partners)
    return (Stretch(float(track.t_s[0]), at, before), Stretch(at, float(track.t_s[-1]), after))


def _located(
    track: TrackSeries,
    before: tuple[Clock, list[_Piece]],
    after: tuple[Clock, list[_Piece]],
    between_s: tuple[float, float],
    partners: dict[str, tuple[list[TrackSeries], Clock]],
) -> float:
    """The stamp at which a track passes from one clock to the other: what is after it fits the second better."""
    low, high = between_s[0] - PIECE_S / 2, between_s[1] + PIECE_S / 2
    inside = (track.t_s >= low) & (track.t_s <= high)
    if inside.sum() < 2:
        return float(np.mean(between_s))
    better = np.zeros(int(inside.sum()))
    for own, clock in partners.values():
        other = chain(own)
        costs = [_cost(track, one, run, other, clock, inside) for one, run in (before, after)]
        both = np.isfinite(costs[0]) & np.isfinite(costs[1])
        better[both] += np.log(costs[1][both] / costs[0][both])  # above zero where the first clock fits better
    # The split that leaves most of the evidence for the first before it, and for the second after it.
    total = np.concatenate([[0.0], np.cumsum(better)])
    at = int(np.argmax(total))
    t = track.t_s[inside]
    return float(t[min(at, len(t) - 1)])


def _cost(
    track: TrackSeries, clock: Clock, run: list[_Piece], other: TrackSeries, others: Clock, where: NDArray[np.bool_]
) -> Array:
    """(N,) squared epipolar error of a track's rows `where`, with a geometry from the rows of a run; NaN if unseen."""
    stamps = (clock.offset_s + track.t_s * (1 + clock.rate) - others.offset_s) / (1 + others.rate)
    there = other.at(stamps)
    seen = np.isfinite(there[:, 0])
    sure = seen & (track.t_s >= run[0].from_s) & (track.t_s <= run[-1].to_s)
    if sure.sum() < 4 * SHORTEST_TRACK:
        return np.full(int(where.sum()), np.nan)
    one, two = _centred(track.rays, sure), _centred(there, sure)
    products = (two[:, :, None] * one[:, None, :]).reshape(-1, 9)
    _, vectors = np.linalg.eigh(products[sure].T @ products[sure])
    squared = np.asarray((products @ vectors[:, 0]) ** 2, float)
    return np.where(seen, squared + float(np.median(squared[sure])), np.nan)[where]


def _centred(rays: Array, which: NDArray[np.bool_]) -> Array:
    middle = rays[which].mean(0)
    scale = float(np.linalg.norm(rays[which] - middle, axis=1).mean())
    return np.column_stack([(rays - middle) / scale, np.ones(len(rays))])
