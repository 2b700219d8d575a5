"""Clocks that disagree: what has to be added to one camera's stamps so that both saw the object at once.

The hazard is that a wrong clock does not look wrong: two tracks of one flight, read half a second apart, still make
plausible essential matrices, and the error comes out as metres. It shows in one number: how well *any* epipolar
geometry explains the pair. That is the smallest eigenvalue of the eight-point system, cheap enough to be computed for
thousands of offsets; it falls off a cliff at the right one. A short overlap fits everything, so what is compared is
the likelihood, which grows with the number of common rows, not the misfit alone.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from calib.solving.series import SHORTEST_TRACK, TrackSeries, even
from edge.common.arrays import Array

ALIGNED_ROWS: Final = 240  # rows of a pair that are compared: thirty unknown-free ones for each of the eight unknowns
COARSE_STEP_S: Final = 0.1  # a UAV at 10 m/s and 100 m moves 10 mrad in it: well inside the cliff's width
FINE_STEP_S: Final = 0.01  # the adjustment takes over from here
NEAR_S: Final = 3.0  # clocks that were set at all agree to this
FAR_S: Final = 120.0  # clocks that were set by hand
LONGEST_PAIRS: Final = 6  # combinations of two cameras' longest tracks that are tried
CONVINCING: Final = 1.5  # log ratio of misfit a row, against the typical offset, that no chance alignment reaches
CONVINCING_FAR: Final = 3.0  # the same for an offset that only a far search finds: forty times as many chances
SMALLEST_MISFIT: Final = 1e-24  # keeps the logarithm finite for noiseless tracks


@dataclass(frozen=True)
class Alignment:
    """second's stamps + offset_s = first's time. gain: log ratio of misfits a row; score: gain times rows.

    gain_as_stamped: the gain at no offset at all, -inf if the two share nothing then.
    """

    offset_s: float
    gain: float
    score: float
    gain_as_stamped: float


def align(first: list[TrackSeries], second: list[TrackSeries], range_s: float = NEAR_S) -> Alignment | None:
    """The offset of the second camera's clock to the first's within +-range_s; None if the pair shares too little."""
    pairs = sorted(
        ((one, two) for one in first for two in second),
        key=lambda pair: -min(pair[0].duration_s, pair[1].duration_s),
    )[:LONGEST_PAIRS]
    found = [_align_tracks(one, two, range_s) for one, two in pairs]
    return max((alignment for alignment in found if alignment), key=lambda a: a.score, default=None)


def _align_tracks(one: TrackSeries, two: TrackSeries, range_s: float) -> Alignment | None:
    coarse = np.arange(-range_s, range_s + COARSE_STEP_S / 2, COARSE_STEP_S)
    misfit, rows = _misfit(one, two, coarse)
    usable = rows >= max(3 * SHORTEST_TRACK, 0.2 * rows.max(initial=0))
    if not usable.any():
        return None
    typical = float(np.median(np.log(misfit[usable])))
    best = coarse[int(np.argmax(np.where(usable, rows * (typical - np.log(misfit)), -np.inf)))]
    fine = best + np.arange(-COARSE_STEP_S, COARSE_STEP_S + FINE_STEP_S / 2, FINE_STEP_S)
    misfit, rows = _misfit(one, two, fine)
    at = int(np.argmax(rows * (typical - np.log(misfit))))
    gain = typical - float(np.log(misfit[at]))
    (as_stamped,), (shared,) = _misfit(one, two, np.zeros(1))
    gain_as_stamped = typical - float(np.log(as_stamped)) if shared >= rows[at] / 2 else -np.inf
    return Alignment(float(fine[at]), gain, gain * float(rows[at]), gain_as_stamped)


def _misfit(one: TrackSeries, two: TrackSeries, offsets: Array) -> tuple[Array, Array]:
    """Mean squared algebraic epipolar error (K,) for each offset (K,), and how many rows (K,) it is the mean of."""
    # Rows are taken where the second camera saw something at any of the offsets.
    keep = (one.t_s >= two.t_s[0] + offsets[0] - 1) & (one.t_s <= two.t_s[-1] + offsets[-1] + 1)
    chosen = np.flatnonzero(keep)
    if len(chosen) < SHORTEST_TRACK:
        return np.ones(len(offsets)), np.zeros(len(offsets))
    chosen = chosen[even(len(chosen), ALIGNED_ROWS)]
    t, rays1 = one.t_s[chosen], _spread(one.rays[chosen])
    scale, shift = _scaling(two.rays)
    systems, rows = np.empty((len(offsets), 9, 9)), np.empty(len(offsets))
    x1 = np.column_stack([rays1, np.ones(len(rays1))])
    for index, offset in enumerate(offsets):
        rays2 = (two.at(t - offset) - shift) * scale
        good = np.isfinite(rays2[:, 0])
        x2 = np.column_stack([rays2[good], np.ones(int(good.sum()))])
        A = (x2[:, :, None] * x1[good][:, None, :]).reshape(-1, 9)
        systems[index], rows[index] = A.T @ A, good.sum()
    smallest = np.linalg.eigvalsh(systems)[:, 0] / np.maximum(rows, 1)
    return np.where(rows > 9, np.maximum(smallest, SMALLEST_MISFIT), 1.0), rows


def _scaling(rays: Array) -> tuple[float, Array]:
    middle = rays.mean(0)
    return 1 / max(float(np.linalg.norm(rays - middle, axis=1).mean()), 1e-12), middle


def _spread(rays: Array) -> Array:
    scale, shift = _scaling(rays)
    spread: Array = (rays - shift) * scale
    return spread


def align_all(
    tracks: dict[str, list[TrackSeries]], range_s: float = NEAR_S, trusted: frozenset[str] = frozenset()
) -> dict[str, float]:
    """Seconds to add to each camera's stamps; cameras that no pair convincingly ties to the others are not in it.

    trusted: cameras whose clocks are known to be right. Between two of them the stamps stand unless the tracks
    contradict them as convincingly as any alignment must be, and they are never missing from the answer.
    """
    names = sorted(tracks, key=lambda name: -sum(track.duration_s for track in tracks[name]))
    edges = []
    for one, two in combinations(names, 2):
        alignment = align(tracks[one], tracks[two], range_s)
        both = one in trusted and two in trusted
        if alignment and both and alignment.gain - alignment.gain_as_stamped < CONVINCING:
            edges.append((np.inf, one, two, 0.0))
        elif alignment and alignment.gain > (CONVINCING if abs(alignment.offset_s) <= NEAR_S else CONVINCING_FAR):
            edges.append((alignment.score, one, two, alignment.offset_s))
    offsets = _spanned(names, sorted(edges, key=lambda edge: -edge[0]))
    right = [offsets[name] for name in sorted(trusted) if name in offsets]
    zero = float(np.median(right)) if right else 0.0
    return {name: 0.0 for name in names if name in trusted} | {name: value - zero for name, value in offsets.items()}


def _spanned(names: list[str], edges: list[tuple[float, str, str, float]]) -> dict[str, float]:
    """Offsets of all cameras that edges (surest first) tie to the first name."""
    offsets = {names[0]: 0.0} if names else {}
    while True:
        reach = next((edge for edge in edges if (edge[1] in offsets) != (edge[2] in offsets)), None)
        if reach is None:
            return offsets
        _, one, two, offset = reach
        if one in offsets:
            offsets[two] = offsets[one] + offset
        else:
            offsets[one] = offsets[two] - offset
