"""The observations kept for calibrating: bounded, and thinned where they are old.

The hazard is memory, and its cure: throwing the oldest away forgets the only time two cameras shared an object. So a
full window loses every other row of its older half instead; the flight stays whole and gets sparser into the past.
A source that ends, a recording, is kept in whole: a row takes 40 bytes here and several times as many in the source.
"""

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.observations import Frame, Observations
from edge.common.arrays import Array
from edge.common.units import NS
from edge.messages import MAX_DETECTIONS

GROWTH: Final = 1.25  # of the limit, before it is thinned: thinning at every row would be slow
SPARE_ROWS: Final = 2 * MAX_DETECTIONS  # room beyond that for one frame; where there is no limit, to begin with


class CameraWindow:
    """One camera's rows: stamp, pixel, track number, sigma. limit: None keeps all."""

    def __init__(self, limit: int | None) -> None:
        self._limit = limit
        room = int((limit or 0) * GROWTH) + SPARE_ROWS
        self._t: NDArray[np.int64] = np.empty(room, np.int64)
        self._row: Array = np.empty((room, 3))
        self._label: NDArray[np.int64] = np.empty(room, np.int64)
        self._count = 0
        self.seconds: dict[int, int] = {}  # whole second: rows that were seen in it

    def __len__(self) -> int:
        return self._count

    def add(self, frame: Frame) -> None:
        """Take a frame's measurements."""
        n = len(frame.pixels)
        if n == 0:
            return
        if self._count + n > len(self._t):
            if self._limit is None:
                self._make_room(2 * (self._count + n))
            else:
                self._thin()
                self._leave_room(n)
        at = slice(self._count, self._count + n)
        self._t[at], self._label[at] = frame.t_unix_ns, frame.label
        self._row[at, :2], self._row[at, 2] = frame.pixels, frame.sigma_px
        self._count += n
        second = frame.t_unix_ns // NS
        self.seconds[second] = self.seconds.get(second, 0) + n

    def forget_before(self, t_unix_ns: int) -> None:
        """Drop what is older: out of the window, or from before the camera was moved."""
        first = int(np.searchsorted(self._t[: self._count], t_unix_ns))
        self._keep(np.arange(first, self._count))
        self.seconds = {second: n for second, n in self.seconds.items() if second >= t_unix_ns // NS}

    def clear(self) -> None:
        """Drop everything."""
        self._count, self.seconds = 0, {}

    def _make_room(self, room: int) -> None:
        rest = room - len(self._t)
        self._t = np.concatenate([self._t, np.empty(rest, np.int64)])
        self._row = np.concatenate([self._row, np.empty((rest, 3))])
        self._label = np.concatenate([self._label, np.empty(rest, np.int64)])

    def _thin(self) -> None:
        half = self._count // 2
        # Whole frames go or stay: rows of one stamp belong together.
        _, frame = np.unique(self._t[:half], return_inverse=True)
        self._keep(np.concatenate([np.nonzero(frame % 2 == 0)[0], np.arange(half, self._count)]))

    def _leave_room(self, n: int) -> None:
        """Drop the oldest, where thinning was not enough: frames of a thousand detections beside frames of one."""
        most = max(len(self._t) - n, 0)
        if self._count > most:
            first = self._count - most
            torn = self._t[first : self._count] == self._t[first - 1]
            self._keep(first + np.nonzero(~torn)[0])
            oldest = int(self._t[: self._count].min(initial=np.iinfo(np.int64).max)) // NS
            self.seconds = {second: rows for second, rows in self.seconds.items() if second >= oldest}

    def _keep(self, which: NDArray[np.intp]) -> None:
        for array in (self._t, self._label, self._row):
            array[: len(which)] = array[: self._count][which]
        self._count = len(which)

    def observations(self) -> Observations:
        """A copy of what is kept, at most the limit, in the calibration's terms."""
        every = 1 if self._limit is None else max(1, -(-self._count // self._limit))
        at: slice | NDArray[np.intp] = slice(self._count % every, self._count, every)
        if np.any(np.diff(self._t[at]) < 0):  # rows that came late
            at = np.argsort(self._t[: self._count], kind="stable")[at]
        sigma = self._row[at, 2]
        return Observations(
            self._t[at].copy(),
            self._row[at, :2].copy(),
            self._label[at].copy(),
            None if np.isnan(sigma).any() else sigma.copy(),
        )


class Window:
    """The windows of all cameras. limit: rows a camera, window_s: seconds kept; None keeps all."""

    def __init__(self, cameras: Iterable[str], limit: int | None = None, window_s: float | None = None) -> None:
        self.cameras = {camera: CameraWindow(limit) for camera in cameras}
        self._window_ns = None if window_s is None else round(window_s * NS)

    def add(self, frame: Frame) -> None:
        """Take a frame's measurements."""
        self.cameras[frame.camera].add(frame)

    def expire(self, now_unix_ns: int) -> None:
        """Drop what has left the window."""
        if self._window_ns is None:
            return
        for camera in self.cameras.values():
            if camera.seconds and next(iter(camera.seconds)) < (now_unix_ns - self._window_ns) // NS - 5:
                camera.forget_before(now_unix_ns - self._window_ns)

    def shared_s(self, one: str, other: str) -> int:
        """Seconds in which both cameras saw something: what tells their relative pose."""
        return len(self.cameras[one].seconds.keys() & self.cameras[other].seconds.keys())
