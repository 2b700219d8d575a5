"""Rows that no camera saw: a constant written for an unseen frame, the last position said again, a picture that froze.

The hazard is that such rows look better than any measurement: they have no noise at all. A constant draws the flight to
a corner of the picture, a held position holds it back, and the adjustment believes both, for most of their neighbours
are right. What gives them away is exactly that: the very same pixel, frame after frame or again and again, and a jump
to or from it that nothing near it made. A hovering object has the same pixel too where a detector rounds; but it comes
and goes in small steps, and nothing is lost with it.
"""

from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

QUANTA_PX: Final = (1.0, 0.5, 0.25, 0.1, 0.05, 0.01)  # what detectors and files round to
QUANTUM_SHARE: Final = 0.97  # of pixels that must lie on the grid
COARSE_PX: Final = 0.5  # from here on an object that stands has the same pixel several times
FINE_PX: Final = 0.02  # below it no two measurements are alike
LEAST_RUN: Final = {"coarse": 4, "middle": 3, "fine": 2}  # rows alike, that are no accident
BRIDGED_FRAMES: Final = 2  # a run of equal pixels goes on across a frame that was lost
LONGEST_EDGE_S: Final = 0.7  # between a run and the frame before or after it, to call what lies between a jump
LEAST_EDGE_RAY: Final = 0.02  # 2 m at 100 m
EDGE_PACES: Final = 4.0  # times what an object moves in that time
MOSTLY_JUMPED: Final = 0.6  # of the beginnings and ends of its runs, where the constant was jumped to or from
FEWEST_CONSTANT: Final = 3  # rows: a false detection may come twice at one place
WAY_OUT_STEPS: Final = 2.5  # times the steps around it, of the step out of a held position
FINE_WAY_OUT_STEPS: Final = 1.5  # the same where no two measurements are alike: one row held is enough
FROZEN_ROWS: Final = 10  # to the end of the flight, with no way out to be seen
SURE: Final = 1e-9  # chance of so long a run by rounding alone
BEFORE_FRAMES: Final = 20  # before a run, that tell how what is seen there trembles
FEWEST_BEFORE: Final = 6  # of them
STILL_PX: Final = 0.25  # less is no movement
ROUNDING: Final = 1.5  # quanta squared: three times what rounding alone makes of second differences


@dataclass(frozen=True)
class Unseen:
    """Which rows are no measurement: (N,) those with a constant, and those that repeat an earlier position."""

    constant: NDArray[np.bool_]
    held: NDArray[np.bool_]

    @property
    def rows(self) -> NDArray[np.bool_]:
        """(N,) all of them."""
        return self.constant | self.held


@dataclass(frozen=True)
class _Runs:
    """Equal pixels in consecutive frames. rows: by run, in time order; value: (R,) which, ascending."""

    rows: list[NDArray[np.int64]]
    value: NDArray[np.int64]


def unseen(t_s: Array, pixels: Array, focal_px: float) -> Unseen:
    """Which rows of a camera, t_s (N,) in time order, pixels (N, 2), were written without anything being seen."""
    none = np.zeros(len(t_s), bool)
    if len(t_s) < 2:
        return Unseen(none, none)
    frame_s, frame = np.unique(t_s, return_inverse=True)
    values, value = np.unique(pixels, axis=0, return_inverse=True)
    value = value.reshape(-1)
    if len(values) == len(pixels):
        return Unseen(none, none)
    picture = _Picture(frame_s, frame, pixels, focal_px)
    constant = _constants(picture, _runs(frame, value, 1), none)
    left = ~constant
    quantum = quantum_px(pixels[left])
    least = LEAST_RUN["coarse" if quantum >= COARSE_PX else "fine" if quantum < FINE_PX else "middle"]
    held = none.copy()
    for run in _runs(frame, np.where(left, value, -1 - np.arange(len(value))), least).rows:
        if picture.is_held(run, quantum):
            held[run[1:]] = True
    return Unseen(constant, held)


def _runs(frame: NDArray[np.int64], value: NDArray[np.int64], least: int) -> _Runs:
    order = np.lexsort((frame, value))
    apart = (np.diff(value[order]) != 0) | (np.diff(frame[order]) > BRIDGED_FRAMES)
    rows = [run for run in np.split(order, np.flatnonzero(apart) + 1) if len(run) >= least]
    return _Runs(rows, np.array([value[run[0]] for run in rows], np.int64))


def _constants(picture: "_Picture", runs: _Runs, none: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) rows with a pixel that was jumped to and from."""
    constant = none.copy()
    for _, alike in groupby(zip(runs.value.tolist(), runs.rows, strict=True), key=itemgetter(0)):
        own = [rows for _, rows in alike]
        if sum(map(len, own)) < FEWEST_CONSTANT:
            continue
        jumps = [jump for run in own for jump in picture.jumps(run) if jump is not None]
        if jumps and np.mean(jumps) >= MOSTLY_JUMPED:
            constant[np.concatenate(own)] = True
    return constant


def quantum_px(pixels: Array) -> float:
    """The grid that pixels (N, 2) lie on, 0 if on none."""
    if len(pixels) == 0:
        return 0.0
    for quantum in QUANTA_PX:
        steps = pixels / quantum
        if np.mean(np.abs(steps - np.round(steps)) < 1e-6) > QUANTUM_SHARE:
            return quantum
    return 0.0


class _Picture:
    """A camera's rows by frame, and how far things move in it."""

    def __init__(self, frame_s: Array, frame: NDArray[np.int64], pixels: Array, focal_px: float) -> None:
        self._frame_s, self._frame, self._pixels = frame_s, frame, pixels
        self._start = np.searchsorted(frame, np.arange(len(frame_s) + 1))
        self._least_px = LEAST_EDGE_RAY * focal_px
        near = self._nearest_before()
        moved = near[near[:, 0] > 0]
        self._pace_px_s = float(np.median(moved[:, 0] / moved[:, 1])) if len(moved) else 0.0

    def _nearest_before(self) -> Array:
        """(N', 2) px to the nearest row of the frame before, and seconds since; one row a frame."""
        before = np.arange(self._start[-2])  # every row but those of the last frame
        off = np.linalg.norm(self._pixels[self._start[self._frame[before] + 1]] - self._pixels[before], axis=1)
        return np.column_stack([np.minimum.reduceat(off, self._start[:-2]), np.diff(self._frame_s)])

    def _step(self, row: int, frame: int) -> float | None:
        """Px from a row to the nearest one of a frame; None if that is none, or too long before or after."""
        if not 0 <= frame < len(self._frame_s):
            return None
        if abs(self._frame_s[frame] - self._frame_s[self._frame[row]]) > LONGEST_EDGE_S:
            return None
        there = self._pixels[self._start[frame] : self._start[frame + 1]]
        return float(np.min(np.linalg.norm(there - self._pixels[row], axis=1)))

    def _far(self, row: int, frame: int) -> bool | None:
        step = self._step(row, frame)
        if step is None:
            return None
        gap_s = abs(self._frame_s[frame] - self._frame_s[self._frame[row]])
        return bool(step > max(self._least_px, EDGE_PACES * self._pace_px_s * gap_s))

    def jumps(self, run: NDArray[np.int64]) -> tuple[bool | None, bool | None]:
        """Whether a run was jumped to, and from."""
        return self._far(run[0], self._frame[run[0]] - 1), self._far(run[-1], self._frame[run[-1]] + 1)

    def is_held(self, run: NDArray[np.int64], quantum_px: float) -> bool:
        """Whether a run of equal pixels, that came there in small steps, was left by a large one, or never."""
        first, last = int(self._frame[run[0]]), int(self._frame[run[-1]])
        into = self._step(run[0], first - 1) or 0.0
        out = self._step(run[-1], last + 1)
        if out is None:
            if last < len(self._frame_s) - 1 or len(run) < FROZEN_ROWS:
                return False
            return self._froze(run, into, quantum_px)
        after = self._after(last + 1)
        if quantum_px < FINE_PX:
            return out > FINE_WAY_OUT_STEPS * max(into, after)
        return out > max(3 * quantum_px, WAY_OUT_STEPS * max(into, after))

    def _after(self, frame: int) -> float:
        """The step of what comes after, in the next frame."""
        if frame >= len(self._frame_s):
            return 0.0
        return self._step(int(self._start[frame]), frame + 1) or 0.0

    def _froze(self, run: NDArray[np.int64], into: float, quantum_px: float) -> bool:
        """Whether what was seen until then moved, or trembled so that it cannot have stood so still."""
        if into > max(3 * quantum_px, STILL_PX):
            return True
        path = self._pixels[self._history(int(run[0]))]
        if len(path) < FEWEST_BEFORE:
            return False
        trembled = float(np.max(np.mean(np.diff(path, n=2, axis=0) ** 2, axis=0)))
        alike = int(np.sum(np.all(np.diff(path, axis=0) == 0, axis=1)))
        chance = ((alike + 1) / len(path)) ** (len(run) - 1)
        return trembled > ROUNDING * quantum_px**2 + STILL_PX**2 and chance < SURE

    def _history(self, row: int) -> list[int]:
        """The rows that led there: in each frame before, the nearest."""
        path = [row]
        for frame in range(int(self._frame[row]) - 1, max(-1, int(self._frame[row]) - 1 - BEFORE_FRAMES), -1):
            rows = np.arange(self._start[frame], self._start[frame + 1])
            path.append(int(rows[np.argmin(np.linalg.norm(self._pixels[rows] - self._pixels[path[-1]], axis=1))]))
        return path
