"""Tracks cut where they go over from one object to another, as the other cameras see it.

The hazard is the exchange that no picture shows: two objects meet in one camera's picture and leave it with each
other's numbers, without any jump. The other cameras see them far apart all the time. So a track is cut where it stops
agreeing with one track of another camera while one of the two begins to agree with a third, unless somebody vouches
for it: another camera's track that agrees with it before and after.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from calib.solving.agreement import Gridded, TrackPair, contested
from calib.solving.series import SHORTEST_TRACK
from edge.common.arrays import Array

LASTING: Final = 8  # instants that two tracks agree, and differ, before anything is cut
VOUCHED: Final = 16  # instants on either side, in which a witness must agree
CLEAR_INSTANTS: Final = 3  # instants next to the cut that may be anything: the two objects are near each other
FEWEST_BETWEEN: Final = 5  # instants between two cuts
Index = tuple[int, int]  # of two cameras' tracks


def cuts(gridded: list[Gridded], pairs: dict[Index, TrackPair]) -> dict[int, list[int]]:
    """Grid instants at which tracks (by index) change their object. pairs: of the indices of different cameras."""
    found: dict[int, set[int]] = {}
    for one, two, at in _changes(gridded, pairs):
        for index in (one, two):
            if not _vouched(index, at, pairs, but=(one, two)):
                found.setdefault(index, set()).add(at)
    return {index: _apart(sorted(at)) for index, at in found.items()}


def _changes(gridded: list[Gridded], pairs: dict[Index, TrackPair]) -> Iterator[tuple[int, int, int]]:
    """Two tracks and an instant at which they begin or cease to be one object."""
    for own in _by_cameras(gridded, pairs):
        for (i, j), against in contested(own).items():
            pair = own[i, j]
            if pair.agree.sum() < LASTING or against.sum() < LASTING:
                continue
            state = pair.agree.astype(np.int64) - against
            known = np.flatnonzero(state)
            for k in np.flatnonzero(np.diff(state[known])).tolist():
                yield i, j, _best_cut(pair, int(known[k]), int(known[k + 1]), begins=state[known[k]] < 0)


def _by_cameras(gridded: list[Gridded], pairs: dict[Index, TrackPair]) -> list[dict[Index, TrackPair]]:
    """The pairs of each two cameras."""
    groups: dict[tuple[str, str], dict[Index, TrackPair]] = {}
    for (i, j), pair in pairs.items():
        groups.setdefault((gridded[i].camera, gridded[j].camera), {})[i, j] = pair
    return list(groups.values())


def _best_cut(pair: TrackPair, low: int, high: int, *, begins: bool) -> int:
    """The instant between two states at which the misfit parts best."""
    span = np.arange(low, high + 1)
    misfit = np.nan_to_num(np.minimum(pair.misfit[span], 1.0), nan=0.0)  # behind a camera is far enough
    scale = np.minimum(misfit, np.median(misfit) * 4 + 1e-12)
    towards = np.cumsum(scale - scale.mean())
    return int(span[np.argmax(towards) if begins else np.argmin(towards)]) + 1


def _vouched(index: int, at: int, pairs: dict[Index, TrackPair], but: Index) -> bool:
    """Whether some other camera's track agrees with a track before and after an instant."""
    for both, pair in pairs.items():
        if index not in both or both == but:
            continue
        before = slice(max(0, at - VOUCHED), max(0, at - CLEAR_INSTANTS))
        after = slice(at + CLEAR_INSTANTS, at + VOUCHED)
        if pair.agree[before].any() and pair.agree[after].any() and not pair.differ[before.start : after.stop].any():
            return True
    return False


def _apart(at: list[int]) -> list[int]:
    """Cuts, those that are hardly apart taken as one."""
    kept: list[int] = []
    for instant in at:
        if not kept or instant - kept[-1] >= FEWEST_BETWEEN:
            kept.append(instant)
    return kept


def pieces(one: Gridded, at: list[int], grid_s: Array, offset_s: float, first_number: int) -> list[Gridded]:
    """A track in pieces, numbered on from first_number; those too short to say anything are left out."""
    if not at:
        return [one]
    bounds = [-np.inf, *(grid_s[min(k, len(grid_s) - 1)] - offset_s for k in at), np.inf]
    made = []
    for k, (begin, end) in enumerate(pairwise(bounds)):
        rows = np.flatnonzero((one.track.t_s >= begin) & (one.track.t_s < end))
        if len(rows) >= SHORTEST_TRACK:
            inside = (grid_s - offset_s >= begin) & (grid_s - offset_s < end)
            rays = np.where(inside[:, None], one.rays, np.nan)
            part = replace(one.track.rows(rows), number=first_number + k)
            made.append(replace(one, track=part, rays=rays))
    return made
