"""Whether a camera's track numbers say what belongs together, and the tracks by motion where they do not.

The hazard is a number that is believed: a tracker that exchanges two, a detector that numbers what it sees from left to
right, one that counts on with every row. So numbers are held against the picture: nothing jumps, and nothing is in two
places at once. Where they hold, they are kept as they are. Where they do not, they count for nothing in that camera,
and its rows are linked anew (linking.py).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.solving.linking import TURN_RAY_S2, link
from edge.common.arrays import Array

MEDIAN_OF: Final = 9  # rows: four outliers among them do not move the median
LEAST_JUMP_RAY: Final = 0.01  # ray units: what a fast object or a coarse camera moves between rows is no outlier
JUMP_PACES: Final = 9.0  # times what it moves between rows: twice what a turn within the nine can look like
SOUND_WINDOWS: Final = 0.8  # of nines, in which outliers are no majority even where three rows of ten are
LONGEST_STEP_S: Final = 0.7  # between two rows, in which an object may be anywhere
SIDE: Final = 5  # rows on either side of a jump, that tell where things were going
LEAST_LEAP_RAY: Final = 0.03  # 3 m at 100 m: nearer ones are for geometry to tell
LEAP_PACES: Final = 5.0  # times the way that either side makes in that time
SHARED_NUMBERS: Final = 0.02  # of rows, that have their number twice in a frame
FEWEST_SHARED_NUMBERS: Final = 5  # rows
SHORT_ROWS: Final = 12  # a number of fewer rows says nothing of a path
SHORT_S: Final = 1.5  # nor one that lasts less
SHORT_SHARE: Final = 0.6  # of rows that are in so short tracks, where a tracker counts on
CHAINED: Final = 0.5  # of the short tracks, that begin where another has just ended: not birds, that come and go


@dataclass(frozen=True)
class Numbering:
    """label: (N,) which rows belong together. fault: what is wrong with the camera's own numbers, or empty.

    at_s: when it showed first. times: how often.
    """

    label: NDArray[np.int64]
    fault: str = ""
    at_s: float = 0.0
    times: int = 0


def judged(t_s: Array, rays: Array, number: NDArray[np.int64]) -> Numbering:
    """A camera's numbers (N,) held against its rows: t_s (N,) in time order, rays (N, 2), NaN beyond the lens model."""
    finite = np.flatnonzero(np.isfinite(rays[:, 0]))
    seen = _angles(rays[finite])
    fault, at_s, times = _fault(t_s[finite], seen, number[finite])
    if not fault:
        return Numbering(number)
    label = np.full(len(t_s), -1, np.int64)
    label[finite] = link(t_s[finite], seen)
    return Numbering(label, fault, at_s, times)


def _angles(rays: Array) -> Array:
    """(N, 2) radians off the axis: far off it, a ray's coordinates run away from whoever moves steadily."""
    off = np.linalg.norm(rays, axis=1)
    shrunk: Array = rays * (np.arctan(off) / np.maximum(off, 1e-12))[:, None]
    return shrunk


def on_a_path(rays: Array) -> NDArray[np.bool_]:
    """(N,) which rows of a track lie where their neighbours say it was (Hampel 1974): an outlier is no path."""
    if len(rays) < MEDIAN_OF:
        return np.ones(len(rays), bool)
    padded = np.pad(rays, ((MEDIAN_OF // 2, MEDIAN_OF // 2), (0, 0)), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, MEDIAN_OF, axis=0)
    middle = np.median(around, axis=2)
    off = np.abs(around - middle[:, :, None]).max(axis=1)
    # What the third nearest of nine is off by: how fast it moves there, unless the window is full of outliers.
    pace = np.sort(off, axis=1)[:, 2]
    allowed = np.maximum(LEAST_JUMP_RAY, JUMP_PACES * np.minimum(pace, np.quantile(pace, SOUND_WINDOWS)))
    near: NDArray[np.bool_] = np.abs(rays - middle).max(axis=1) <= allowed
    return near


def _fault(t_s: Array, rays: Array, number: NDArray[np.int64]) -> tuple[str, float, int]:
    order = np.lexsort((t_s, number))
    t, ray, own = t_s[order], rays[order], number[order]
    same = np.diff(own) == 0
    # Doubled rows are one row.
    shared = np.flatnonzero(same & (np.diff(t) == 0) & np.any(np.diff(ray, axis=0) != 0, axis=1))
    if len(shared) > max(FEWEST_SHARED_NUMBERS, SHARED_NUMBERS * len(t)):
        return "one number stands for several objects in a frame", float(t[shared].min()), len(shared)
    starts = np.flatnonzero(np.concatenate([[True], ~same]))
    tracks = np.split(np.arange(len(t)), starts[1:])
    if _counts_on(t, ray, tracks):
        return "a number lasts for moments only and the next begins where it ended", float(t.min()), len(tracks)
    leaps = []
    for rows in tracks if len(tracks) > 1 else ():
        rest = number != own[rows[0]]
        leaps += _leaps(t[rows], ray[rows], t_s[rest], rays[rest])
    if leaps:
        return "track numbers go from one object to another", min(leaps), len(leaps)
    return "", 0.0, 0


def _counts_on(t_s: Array, rays: Array, tracks: list[NDArray[np.int64]]) -> bool:
    """Whether most rows are in tracks too short to be any, that go on one in the other."""
    begin, end = (np.array([t_s[rows[k]] for rows in tracks]) for k in (0, -1))
    rows_of = np.array([len(rows) for rows in tracks])
    short = (rows_of < SHORT_ROWS) | (end - begin < SHORT_S)
    if rows_of[short].sum() < SHORT_SHARE * len(t_s) or short.sum() < 3:
        return False
    frame_s = float(np.median(np.diff(np.unique(t_s)))) if len(np.unique(t_s)) > 1 else 0.0
    first, last = (np.array([rays[rows[k]] for rows in tracks]) for k in (0, -1))
    order = np.argsort(begin, kind="stable")
    followed = 0
    for k in np.flatnonzero(short).tolist():
        low, high = np.searchsorted(begin[order], [end[k] + 1e-9, end[k] + 2.5 * frame_s])
        after = order[low:high]
        followed += bool(len(after) and np.linalg.norm(first[after] - last[k], axis=1).min() < LEAST_LEAP_RAY)
    return bool(followed >= CHAINED * short.sum())


def _leaps(t_s: Array, rays: Array, others_s: Array, others: Array) -> list[float]:
    """When a track leapt to another object: its rows on either side go on, each its own way, and do not meet.

    Something near that flies past leaps too. But an object that another number had just before, or has just after, was
    there all the time: others_s (K,) in order, others (K, 2) are the rows of all other numbers.
    """
    keep = on_a_path(rays) & np.concatenate([[True], np.diff(t_s) > 0])
    t, ray = t_s[keep], rays[keep]
    step_s, way = np.diff(t), np.linalg.norm(np.diff(ray, axis=0), axis=1)
    at = np.flatnonzero((way > LEAST_LEAP_RAY) & (step_s <= LONGEST_STEP_S)) + 1
    found = []
    for k in at[(at >= SIDE) & (at <= len(t) - SIDE)].tolist():
        before, after = (t[k - SIDE : k], ray[k - SIDE : k]), (t[k : k + SIDE], ray[k : k + SIDE])
        pace = np.median(np.concatenate([(way / step_s)[k - SIDE : k - 1], (way / step_s)[k : k + SIDE - 1]]))
        allowed = LEAST_LEAP_RAY + LEAP_PACES * pace * step_s[k - 1]
        turn = 0.5 * TURN_RAY_S2 * (t[k + SIDE - 1] - t[k - SIDE]) ** 2
        if min(_off_course(*before, *after), _off_course(*after, *before)) <= allowed + turn:
            continue
        low, high = np.searchsorted(others_s, [t[k - 1] - step_s[k - 1], t[k] + step_s[k - 1]])
        near = others_s[low:high], others[low:high]
        if high > low and min(_nearest(*before, *near), _nearest(*after, *near)) < allowed:
            found.append(float(t[k]))
    return found


def _expected(t_s: Array, rays: Array, then_s: Array) -> Array:
    """(K, 2) where rows were going at other times (K,): medians, so that one outlier changes nothing."""
    velocity = np.median(np.diff(rays, axis=0) / np.diff(t_s)[:, None], axis=0)
    expected: Array = np.median(rays[:, None] + (then_s[None] - t_s[:, None])[:, :, None] * velocity, axis=0)
    return expected


def _off_course(t_s: Array, rays: Array, then_s: Array, there: Array) -> float:
    """How far some rows (the median of them) are from where some others were going."""
    return float(np.median(np.linalg.norm(there - _expected(t_s, rays, then_s), axis=1)))


def _nearest(t_s: Array, rays: Array, then_s: Array, there: Array) -> float:
    """How near any of some rows is to where some others were going."""
    return float(np.min(np.linalg.norm(there - _expected(t_s, rays, then_s), axis=1)))
