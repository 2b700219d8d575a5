"""Clocks that disagree: what has to be added to one camera's stamps so that two cameras saw the object at once.

The hazard is that a wrong clock does not look wrong: two tracks of one flight, read half a second apart, still make
plausible essential matrices, and the error comes out as metres. It shows in one number: how well *any* epipolar
geometry explains the pair (`clock_correlation`). That falls off a cliff at the right offset. But some offset is always
the best one, and a short overlap fits everything. So an offset is believed for its score, the log likelihood against
the typical offset's with what eight unknowns fit anyway taken off, and only if no other offset comes near it; the
rest are kept as candidates, for other cameras to confirm or deny (`clock_consensus`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from calib.solving.clock_correlation import LAG_STEP_S, LONG_S, Correlation, normalised_misfit, sample
from calib.solving.series import SHORTEST_TRACK, TrackSeries, even
from edge.common.arrays import Array

NEAR_S: Final = 3.0  # clocks that were set at all agree to this
INDEPENDENT_S: Final = 1.5  # a UAV turns in about this: rows closer together say the same of a clock
EPIPOLAR_UNKNOWNS: Final = 8  # of an epipolar geometry without known lenses
LEAST_GAIN: Final = float(np.log(2))  # a track read between two rows has half the variance of its noise, at any offset
SHORTEST_OVERLAP_S: Final = 15.0  # two rows more than the unknowns, in independent ones
FAR_STEP_S: Final = 0.5  # between the lags of the far search, a fraction of the time a UAV turns in
APART_S: Final = 2.0  # two offsets nearer than this are one optimum
RIVAL: Final = 0.5  # of the best score: what a search in steps has found below that, no finer one will raise above it
KEPT: Final = 4  # optima of a pair that are kept as candidates
CONVINCING: Final = 60.0  # score that unrelated pieces of a flight of three minutes reach once in a hundred pairs
CONTRAST: Final = 1.6  # times the score of the best elsewhere: among chance alignments the two best are nearly equal
NEARNESS: Final = 0.7  # of the far score that a near one needs: a flight that repeats itself fits one round later too
FASTEST_RATE: Final = 6e-3  # s/s: 29.83 frames a second taken for 30 are 5667 ppm
RATE_STEP_S: Final = 0.5  # between two rates that are tried, at the ends of a track
RATE_WORTH: Final = 12.0  # score that a rate of its own must gain, or there is none
LEAST_RATE_S: Final = 0.03  # that a rate makes at the ends of the overlap, below it the adjustment finds it by itself
ALIGNED_ROWS: Final = 240  # rows of a pair that are compared: thirty unknown-free ones for each of the eight unknowns
PASSES: Final = 3  # of looking for strays: beside a large one a small one hides
TYPICAL_OF: Final = 41  # rows: what is usual there, for a turn bends a track more than a straight line does
STRAYS: Final = 6.0  # times what is usual
STRAY_RAY: Final = 2e-3  # and that in ray units, which a smooth track is good for at any rate
# In INDEPENDENT_S. An object that stands still fits every epipolar geometry for as long as it stands; counted as rows
# that agree, a hovering drone put clocks a minute off that were good to milliseconds.
STILL_RAY: Final = 2e-3
LONGEST_PAIRS: Final = 6  # combinations of two cameras' longest tracks that are tried where whole chains do not fit
FINE_STEPS_S: Final = (0.1, 0.05, 0.02, 0.01)  # of the last search; the adjustment takes over from there
FINE_STEP_S: Final = FINE_STEPS_S[-1]
MOST_MOVES: Final = 30  # of a step of the last search: beyond it, it has left the optimum it started from


@dataclass(frozen=True)
class Candidate:
    """second's stamps t + offset_s + rate t = first's stamps, all seconds from t_mid.

    score: log likelihood against the typical offset's and LEAST_GAIN. gain: the log ratio of their misfits.
    overlap_s: seen by both. at_s: middle of the overlap in first's stamps, half_s: half of its length.
    """

    offset_s: float
    rate: float
    gain: float
    score: float
    overlap_s: float
    at_s: float
    half_s: float

    @property
    def likelihood(self) -> float:
        """The log likelihood against the typical offset's, without LEAST_GAIN."""
        return self.score + LEAST_GAIN * float(free_rows(np.array([self.overlap_s]))[0])

    @property
    def shift_s(self) -> float:
        """What is added to the second's stamps at the middle of the overlap."""
        return self.at_s - (self.at_s - self.offset_s) / (1 + self.rate)


@dataclass(frozen=True)
class Alignment:
    """The candidates of a pair, best first. as_stamped: log likelihood of the stamps as they are against the typical
    offset's, None if they share too little to tell; stamped_gain: the log ratio of their misfits.
    convincing: whether the best stands alone.
    """

    candidates: tuple[Candidate, ...]
    as_stamped: float | None
    convincing: bool
    stamped_gain: float = 0.0


def align(
    first: list[TrackSeries], second: list[TrackSeries], near_s: float = NEAR_S, rates: tuple[float, ...] = ()
) -> Alignment:
    """Where the second camera's clock may be against the first's; tracks longest first.

    near_s: offsets within it are preferred. rates: tried besides those that clocks may have.
    """
    best = Alignment((), None, convincing=False)
    for one, two in _combinations(first, second):
        found = _align_tracks(one, two, near_s, rates)
        if _top(found) > _top(best) or not best.candidates:
            best = found
        if best.convincing:
            break
    return best


def _top(alignment: Alignment) -> float:
    return alignment.candidates[0].score if alignment.candidates else -np.inf


def _combinations(first: list[TrackSeries], second: list[TrackSeries]) -> Iterator[tuple[TrackSeries, TrackSeries]]:
    """All of one object first, if there is but one; then the longest tracks by themselves."""
    chains = chain(first), chain(second)
    yield chains
    if len(first) > 1 or len(second) > 1:
        pairs = ((one, two) for one in first for two in second)
        longest = sorted(pairs, key=lambda pair: -min(pair[0].duration_s, pair[1].duration_s))
        yield from ((smooth(one), smooth(two)) for one, two in islice(longest, LONGEST_PAIRS))


def chain(tracks: list[TrackSeries]) -> TrackSeries:
    """A camera's tracks that do not run at the same time, longest first, as one."""
    kept: list[TrackSeries] = []
    for track in tracks:
        if all(track.t_s[-1] < other.t_s[0] or other.t_s[-1] < track.t_s[0] for other in kept):
            kept.append(track)
    kept.sort(key=lambda track: float(track.t_s[0]))
    return smooth(
        TrackSeries(
            tracks[0].number,
            np.concatenate([track.t_s for track in kept]),
            np.concatenate([track.rays for track in kept]),
            np.concatenate([track.row for track in kept]),
        )
    )


def smooth(track: TrackSeries) -> TrackSeries:
    """A track without the rows that its neighbours' straight line misses: a mean of squares bears no outlier."""
    for _ in range(PASSES):
        if len(track.t_s) < SHORTEST_TRACK:
            break
        off = _off_line(track)
        around = np.pad(off, 1)
        typical = median_filter(off, TYPICAL_OF, mode="nearest")
        stray = (off > STRAY_RAY + STRAYS * typical) & (off >= around[:-2]) & (off >= around[2:])
        if not stray.any():
            break
        track = track.rows(~stray)
    return track


def _off_line(track: TrackSeries) -> Array:
    """(N,) how far each row is from the straight line through its two neighbours; zero at the ends and beside gaps."""
    t, rays = track.t_s, track.rays
    share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
    off = np.linalg.norm(rays[1:-1] - (1 - share) * rays[:-2] - share * rays[2:], axis=1)
    close = t[2:] - t[:-2] <= 2 * track.longest_bridge_s
    return np.pad(np.where(close, off, 0.0), 1)


def moving(track: TrackSeries) -> TrackSeries:
    """A track without the rows beside which its object stands still."""
    t_s, last = track.t_s, len(track.t_s) - 1
    before = np.searchsorted(t_s, t_s - INDEPENDENT_S / 2)
    after = np.minimum(np.searchsorted(t_s, t_s + INDEPENDENT_S / 2), last)
    return track.rows(np.linalg.norm(track.rays[after] - track.rays[before], axis=1) > STILL_RAY)


def _align_tracks(one: TrackSeries, two: TrackSeries, near_s: float, rates: tuple[float, ...]) -> Alignment:
    one, two = moving(one), moving(two)
    if min(len(one.t_s), len(two.t_s)) < 2 * SHORTEST_TRACK:
        return Alignment((), None, convincing=False)
    pair = _Pair(one, two)
    found = pair.scan(0.0, near_s)
    if not _stand_out(found, near_s):
        for rate in (*_clock_rates(one, two), *rates):
            found += pair.scan(rate, near_s)
    rivals = sorted(_distinct(found), key=lambda candidate: -_preferred(candidate, near_s))[: 2 * KEPT]
    least = RIVAL * _preferred(rivals[0], near_s) if rivals else 0.0
    found = _distinct([pair.refined(one) for one in rivals if _preferred(one, near_s) >= least])
    ranked = sorted(found, key=lambda candidate: -_preferred(candidate, near_s))[:KEPT]
    return Alignment(tuple(ranked), pair.as_stamped, _stand_out(ranked, near_s), pair.stamped_gain)


def _clock_rates(one: TrackSeries, two: TrackSeries) -> list[float]:
    """Rates other than none at which two tracks are tried."""
    half_s = min(one.duration_s, two.duration_s) / 2
    count = int(np.ceil(FASTEST_RATE * half_s / RATE_STEP_S))
    return [float(rate) for rate in np.linspace(-FASTEST_RATE, FASTEST_RATE, 2 * count + 1) if rate]


def _preferred(candidate: Candidate, near_s: float) -> float:
    """The score, near ones raised: of two that explain the tracks, the near one is the clock's."""
    return candidate.score / NEARNESS if abs(candidate.shift_s) <= near_s else candidate.score


def _stand_out(candidates: list[Candidate], near_s: float) -> bool:
    """Whether the best is convincing and nothing elsewhere comes near it."""
    ranked = sorted((_preferred(candidate, near_s) for candidate in _distinct(candidates)), reverse=True)
    return bool(ranked) and ranked[0] > CONVINCING and ranked[0] > CONTRAST * max(ranked[1:], default=0.0)


def _distinct(candidates: list[Candidate]) -> list[Candidate]:
    """Best first, without those that lie beside a better one."""
    kept: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda one: -one.score):
        if all(abs(candidate.shift_s - other.shift_s) > APART_S for other in kept):
            kept.append(candidate)
    return kept


class _Pair:
    """Two tracks, and the misfit that is typical of offsets at which they have nothing to do with each other."""

    def __init__(self, one: TrackSeries, two: TrackSeries) -> None:
        self.one, self.two = one, two
        self.step_s = LAG_STEP_S if min(one.duration_s, two.duration_s) < LONG_S else 2 * LAG_STEP_S
        self.sampled = sample(one, self.step_s)
        self.typical: float | None = None
        self.as_stamped: float | None = None
        self.stamped_gain = 0.0

    def scan(self, rate: float, near_s: float) -> list[Candidate]:
        """The best few optima over all lags, with the second's stamps stretched by 1 + rate."""
        correlation = Correlation.of(self.sampled, sample(self.two, self.step_s, rate))
        lags = correlation.lags
        lags = lags[correlation.overlap(lags) * self.step_s >= SHORTEST_OVERLAP_S]
        if len(lags) == 0:
            return []
        coarse = lags[:: round(FAR_STEP_S / self.step_s)]
        misfit, overlap_s = self._at_lags(correlation, coarse)
        if self.typical is None:
            self.typical = float(np.median(np.log(misfit)))
            if 0 in lags:
                (misfit_0,), overlap_0 = self._at_lags(correlation, np.zeros(1, np.int64))
                self.stamped_gain = self.typical - float(np.log(misfit_0))
                self.as_stamped = float(free_rows(overlap_0)[0]) * self.stamped_gain
        score = self._score(misfit, overlap_s)
        tops = _peaks(score)
        near = lags[np.abs(lags * self.step_s) <= near_s]
        around = [self._best(correlation, near, inner=True)] if len(near) else []
        reach = round(FAR_STEP_S / self.step_s)
        around += [self._best(correlation, lags[np.abs(lags - coarse[top]) <= reach], inner=False) for top in tops]
        found = [self.at(lag * self.step_s, rate) for lag in around if lag is not None]
        return [candidate for candidate in found if candidate]

    def _at_lags(self, correlation: Correlation, lags: NDArray[np.int64]) -> tuple[Array, Array]:
        """Misfit (K,) and overlap (K,) in seconds."""
        misfit, _ = correlation.misfit(lags)
        return misfit, correlation.overlap(lags) * self.step_s

    def _score(self, misfit: Array, overlap_s: Array) -> Array:
        score: Array = free_rows(overlap_s) * ((self.typical or 0.0) - np.log(misfit) - LEAST_GAIN)
        return score

    def _best(self, correlation: Correlation, lags: NDArray[np.int64], *, inner: bool) -> int | None:
        """The lag of the highest score; none if it lies at the border and must not."""
        at = int(np.argmax(self._score(*self._at_lags(correlation, lags))))
        return None if inner and at in (0, len(lags) - 1) else int(lags[at])

    def at(self, offset_s: float, rate: float) -> Candidate | None:
        """The candidate of one offset and rate; None if the tracks share too little there."""
        rows = self._shared(offset_s, rate)
        if rows is None:
            return None
        t = self.one.t_s[rows]
        misfit, count = self._misfit(rows, np.array([offset_s]), np.array([rate]))
        share = float(count[0]) / len(t)
        inside = (self.one.t_s >= t[0]) & (self.one.t_s <= t[-1])
        seen_s = float(inside.sum() * np.median(np.diff(self.one.t_s[inside])))
        overlap_s = min(seen_s, float(t[-1] - t[0])) * share
        if overlap_s < SHORTEST_OVERLAP_S or self.typical is None:
            return None
        score = float(self._score(misfit, np.array([overlap_s]))[0])
        middle, half = float(t[-1] + t[0]) / 2, float(t[-1] - t[0]) / 2
        return Candidate(offset_s, rate, self.typical - float(np.log(misfit[0])), score, overlap_s, middle, half)

    def _shared(self, offset_s: float, rate: float) -> NDArray[np.int64] | None:
        """The first's rows (N,) while the second's track runs, evenly spread."""
        start, end = (float(self.two.t_s[k]) * (1 + rate) + offset_s for k in (0, -1))
        inside = np.flatnonzero((self.one.t_s >= start) & (self.one.t_s <= end))
        if len(inside) < 2 * SHORTEST_TRACK:
            return None
        rows: NDArray[np.int64] = inside[even(len(inside), ALIGNED_ROWS)]
        return rows

    def _misfit(self, rows: NDArray[np.int64], offset_s: Array, rate: Array) -> tuple[Array, Array]:
        """(K,) for each offset and rate (K,) with these rows (N,) of the first; and how many of them (K,) count."""
        t_s = self.one.t_s[rows]
        first = np.column_stack([_spread(self.one.rays[rows]), np.ones(len(t_s))])
        stamps = (t_s[None] - offset_s[:, None]) / (1 + rate[:, None])
        rays = _spread(self.two.at(stamps.reshape(-1))).reshape(len(offset_s), len(t_s), 2)
        seen = np.isfinite(rays[:, :, 0])
        second = np.concatenate([np.nan_to_num(rays), np.ones((*seen.shape, 1))], axis=2) * seen[:, :, None]
        system = (second[:, :, :, None] * first[None, :, None, :]).reshape(len(offset_s), len(t_s), 9)
        misfit, _ = normalised_misfit(system.transpose(0, 2, 1) @ system, np.ones(2))
        return misfit, seen.sum(axis=1).astype(float)

    def refined(self, candidate: Candidate) -> Candidate:
        """The optimum beside a candidate, by a search in ever smaller steps; with a rate only if that is worth it."""
        alone = self._climbed(candidate, with_rate=False)
        free = self._climbed(alone, with_rate=True)
        makes_s = abs(free.rate) * free.half_s
        runs = abs(free.rate - candidate.rate) <= FASTEST_RATE  # a step in the middle is a rate that no clock has
        return free if runs and free.score > alone.score + RATE_WORTH and makes_s > LEAST_RATE_S else alone

    def _climbed(self, start: Candidate, *, with_rate: bool) -> Candidate:
        rows = self._shared(start.offset_s, start.rate)
        if rows is None or start.half_s <= 0:
            return start
        steps = np.array([(a, b) for a in (-1, 0, 1) for b in ((-1, 0, 1) if with_rate else (0,))], float)
        here = np.array([start.offset_s + start.rate * start.at_s, start.rate * start.half_s])
        for step in FINE_STEPS_S:
            for _ in range(MOST_MOVES):
                tried = here + step * steps
                rates = tried[:, 1] / start.half_s
                misfit, count = self._misfit(rows, tried[:, 0] - rates * start.at_s, rates)
                best = int(np.argmin(np.where(count >= len(rows) / 2, misfit, np.inf)))
                if not steps[best].any():
                    break
                here = tried[best]
        rate = float(here[1]) / start.half_s
        return self.at(float(here[0]) - rate * start.at_s, rate) or start


def free_rows(overlap_s: Array) -> Array:
    """(K,) independent rows more than any epipolar geometry fits."""
    return np.asarray(np.maximum(overlap_s / INDEPENDENT_S - EPIPOLAR_UNKNOWNS, 0.0), float)


def _peaks(score: Array) -> list[int]:
    """Indices of the highest local maxima."""
    padded = np.pad(score, 1, constant_values=-np.inf)
    tops = np.flatnonzero((score > 0) & (score >= padded[:-2]) & (score >= padded[2:]))
    return [int(top) for top in tops[np.argsort(-score[tops], kind="stable")][:KEPT]]


def _spread(rays: Array) -> Array:
    """Rays (N, 2) about their middle, in units of their mean distance from it; NaN stay."""
    middle = np.nanmean(rays, axis=0)
    spread: Array = (rays - middle) / max(float(np.nanmean(np.linalg.norm(rays - middle, axis=1))), 1e-12)
    return spread
