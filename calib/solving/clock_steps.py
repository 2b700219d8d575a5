"""Clocks that do not run evenly: a box that was restarted or set in the middle of the flight, frames lost uncounted.

The hazard is the clock that is right on the average: half of the flight is read at the wrong time, no offset fits, and
pose and lens take the blame; or a small step fits well enough and bends everything. So a track that no steady clock
explains as well as it should is cut into pieces, each is placed in time by itself against cameras whose clocks are
known, and what the pieces say is read: a line is a rate, one jump a step, anything else a clock that is not steady.
"""

from dataclasses import dataclass
from itertools import pairwise, takewhile
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.solving.clock_consensus import Clock, placed
from calib.solving.clock_correlation import normalised_misfit
from calib.solving.clocks import Alignment, align, chain, free_rows
from calib.solving.series import SHORTEST_TRACK, TrackSeries
from edge.common.arrays import Array

PIECE_S: Final = 20.0  # of a track: the shortest that a few cameras together can place
MOST_PIECES: Final = 8  # of a longer flight: more would say no more of a line or a step
LARGEST_STEP_S: Final = 5.0  # that is looked for: a restart takes as long; after a longer one nothing is sought
LEAST_WITNESSES: Final = 2  # partners, if there are two: so short a piece fits one of them somewhere by chance
LEAST_CLOCK_STEP_S: Final = 0.1  # that is called one: of less, two pieces' own errors are a large part
STEADY_S: Final = 0.06  # a piece is placed to a few hundredths


Partners = dict[str, tuple[list[TrackSeries], Clock]]  # their tracks and clocks, by camera


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


def steadiness(tracks: list[TrackSeries], about: Clock, partners: Partners) -> Steadiness:
    """Place the pieces of a camera's tracks by partners whose clocks are known. about: roughly where its own is."""
    whole = chain(tracks)
    pieces = _pieces(whole)
    if len(pieces) < 2:
        return Steadiness()
    found = [place for piece in pieces if (place := _placed(piece, about, partners)) is not None]
    if len(found) < 2:
        return Steadiness()
    start_s, end_s = float(whole.t_s[0]), float(whole.t_s[-1])
    line, ends = _line(found), _ends(found, len(pieces))
    if ends is None:
        return Steadiness((Stretch(start_s, end_s, line),)) if line else Steadiness(unsteady=True)
    before, after = ends
    at = _located(whole, before, after, partners)
    if line is not None and not _fits_better(
        whole, at, (before[0].clock_of(before), after[0].clock_of(after)), line, partners
    ):
        return Steadiness((Stretch(start_s, end_s, line),))
    return Steadiness((Stretch(start_s, at, before[0].clock_of(before)), Stretch(at, end_s, after[0].clock_of(after))))


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
        """What is added to the stamps at the middle."""
        return self.clock.site(self.middle_s) - self.middle_s

    @staticmethod
    def clock_of(run: "list[_Piece]") -> Clock:
        """The one clock of pieces that keep one."""
        return Clock(float(np.median([one.shift_s for one in run])), 0.0)


def _pieces(track: TrackSeries) -> list[TrackSeries]:
    count = int(np.clip(track.duration_s // PIECE_S, 1, MOST_PIECES))
    edges = np.linspace(track.t_s[0], track.t_s[-1], count + 1)
    cut = [(track.t_s >= start) & (track.t_s < end) for start, end in pairwise(edges)]
    return [track.rows(own) for own in cut if own.sum() >= SHORTEST_TRACK]


def _placed(piece: TrackSeries, about: Clock, partners: dict[str, tuple[list[TrackSeries], Clock]]) -> _Piece | None:
    """Where a piece lies in time, if that is certain. Its stamps are taken to be near the site's first."""
    moved = piece.stretched(about.rate).later(about.offset_s)
    said: dict[str, Alignment] = {}
    for name, (own, clock) in partners.items():
        there = _around(chain(own).stretched(clock.rate).later(clock.offset_s), moved)
        if there is not None:
            said[name] = align([there], [moved], LARGEST_STEP_S)
    tied = placed({name: own.candidates for name, own in said.items()}, dict.fromkeys(said, Clock()), LARGEST_STEP_S)
    if tied is None or not tied.certain or len(tied.agreeing) < min(LEAST_WITNESSES, len(said)):
        return None
    rate = (1 + tied.clock.rate) * (1 + about.rate) - 1
    clock = Clock(about.offset_s * (1 + tied.clock.rate) + tied.clock.offset_s, rate)
    return _Piece(float(piece.t_s[0]), float(piece.t_s[-1]), clock)


def _around(track: TrackSeries, piece: TrackSeries) -> TrackSeries | None:
    """The part of a track that a piece may have seen, and as much beside it as tells what is typical."""
    near = (track.t_s >= piece.t_s[0] - PIECE_S) & (track.t_s <= piece.t_s[-1] + PIECE_S)
    return track.rows(near) if near.sum() >= SHORTEST_TRACK else None


def _line(pieces: list[_Piece]) -> Clock | None:
    """The steady clock on which all pieces lie, if there is one; two pieces are no line unless they are one clock."""
    t, shift = np.array([one.middle_s for one in pieces]), np.array([one.shift_s for one in pieces])
    if np.ptp(shift) <= STEADY_S:
        return Clock(float(np.median(shift)), 0.0)
    if len(pieces) < 3:
        return None
    rate, offset = np.polyfit(t, shift, 1)
    return Clock(float(offset), float(rate)) if np.abs(offset + rate * t - shift).max() <= STEADY_S else None


def _ends(pieces: list[_Piece], expected: int) -> tuple[list[_Piece], list[_Piece]] | None:
    """The pieces that keep the first's clock and those that keep the last's, if there is at most one in between."""
    first, last = pieces[0].shift_s, pieces[-1].shift_s
    before = list(takewhile(lambda one: abs(one.shift_s - first) <= STEADY_S, pieces))
    after = list(takewhile(lambda one: abs(one.shift_s - last) <= STEADY_S, reversed(pieces)))[::-1]
    if abs(last - first) <= LEAST_CLOCK_STEP_S or len(before) + len(after) < expected - 1:
        return None
    return before, after


def _located(track: TrackSeries, before: list[_Piece], after: list[_Piece], partners: Partners) -> float:
    """The stamp at which a track passes from one clock to the other: what is after it fits the second better."""
    low, high = before[-1].to_s - PIECE_S / 2, after[0].from_s + PIECE_S / 2
    inside = (track.t_s >= low) & (track.t_s <= high)
    better = np.zeros(int(inside.sum()))
    for own, clock in partners.values():
        one, two = (_cost(track, run, chain(own), clock)[inside] for run in (before, after))
        both = np.isfinite(one) & np.isfinite(two)
        better[both] += np.log(two[both] / one[both])  # above zero where the first clock fits better
    # The split that leaves most of the evidence for the first before it, and for the second after it.
    total = np.concatenate([[0.0], np.cumsum(better)])
    t = np.append(track.t_s[inside], high)
    return float(t[int(np.argmax(total))])


def _fits_better(track: TrackSeries, at_s: float, clocks: tuple[Clock, Clock], line: Clock, partners: Partners) -> bool:
    """Whether a step explains a track better than a rate does."""
    stepped = np.where(track.t_s < at_s, *(clock.offset_s + track.t_s * (1 + clock.rate) for clock in clocks))
    steady = line.offset_s + track.t_s * (1 + line.rate)
    gain = 0.0
    for own, clock in partners.values():
        other = chain(own)
        one, two = (_log_misfit(track, site, other, clock) for site in (steady, stepped))
        gain += float(free_rows(np.array([min(track.duration_s, other.duration_s)]))[0]) * (one - two)
    return gain > 0


def _log_misfit(track: TrackSeries, site_s: Array, other: TrackSeries, clock: Clock) -> float:
    """Log of the mean squared epipolar error of a track's rows at site times (N,) against another camera's."""
    there = other.at((site_s - clock.offset_s) / (1 + clock.rate))
    seen = np.isfinite(there[:, 0])
    if seen.sum() < SHORTEST_TRACK:
        return 0.0
    one, two = _centred(track.rays[seen], slice(None)), _centred(there[seen], slice(None))
    products = (two[:, :, None] * one[:, None, :]).reshape(-1, 9)
    misfit, _ = normalised_misfit((products.T @ products)[None], np.ones(2))
    return float(np.log(misfit[0]))


def _cost(track: TrackSeries, run: list[_Piece], other: TrackSeries, others: Clock) -> Array:
    """(N,) squared epipolar error of a track's rows, with clock and geometry of a run of its pieces; NaN if unseen."""
    clock = _Piece.clock_of(run)
    stamps = (clock.offset_s + track.t_s * (1 + clock.rate) - others.offset_s) / (1 + others.rate)
    there = other.at(stamps)
    seen = np.isfinite(there[:, 0])
    sure = seen & (track.t_s >= run[0].from_s) & (track.t_s <= run[-1].to_s)
    if sure.sum() < 4 * SHORTEST_TRACK:
        return np.full(len(track.t_s), np.nan)
    one, two = _centred(track.rays, sure), _centred(there, sure)
    products = (two[:, :, None] * one[:, None, :]).reshape(-1, 9)
    _, vectors = np.linalg.eigh(products[sure].T @ products[sure])
    squared = np.asarray((products @ vectors[:, 0]) ** 2, float)
    return np.where(seen, squared + float(np.median(squared[sure])), np.nan)


def _centred(rays: Array, which: NDArray[np.bool_] | slice) -> Array:
    middle = rays[which].mean(0)
    scale = float(np.linalg.norm(rays[which] - middle, axis=1).mean())
    return np.column_stack([(rays - middle) / scale, np.ones(len(rays))])
