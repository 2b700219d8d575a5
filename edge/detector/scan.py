"""The full scan: everything in the frame looked at once in a while, so that what does not move is found too.

Live it runs in a thread of its own, behind: the crops must not wait 50 ms for it. Its findings are places to look at
on the next frame rather than detections, for the frame they are about has passed.
"""

import threading
from typing import Final

import cv2
import numpy as np

from edge.capture.frame import Image
from edge.common.arrays import Array
from edge.common.errors import ModelError
from edge.common.own_thread import OwnThread
from edge.detector.look import padded_stack
from edge.detector.skyfix import StackNet

SCAN_CLOSE_S: Final = 1.0  # a scan that is running is waited for; the largest frames take half of it
REDUCED: Final = 4  # the second look, for objects too large for the network at native size
SMALLEST_REDUCED_PX: Final = 64  # px: below this the second look has nothing to see


def scan(net: StackNet, images: list[Image], score_min: float) -> Array:
    """Places `(N, 3)` of u, v, extent where the network sees something, at native and at a quarter of the size."""
    native = _look(net, images, score_min)
    reduced_px = (images[0].shape[1] // REDUCED, images[0].shape[0] // REDUCED)
    if min(reduced_px) < SMALLEST_REDUCED_PX:
        return native
    reduced = [cv2.resize(image, reduced_px, interpolation=cv2.INTER_AREA) for image in images]
    places = _look(net, reduced, score_min)
    places[:, :2] = (places[:, :2] + 0.5) * REDUCED - 0.5
    places[:, 2] *= REDUCED
    return np.concatenate([native, places])


def _look(net: StackNet, images: list[Image], score_min: float) -> Array:
    found = net.run(padded_stack(images, net.multiple_px), score_min)[0]
    places: Array = np.column_stack([found.centre_px, found.size_px.max(axis=1, initial=0.0)])
    return places[np.argsort(-found.score, kind="stable")]


class Scanner(OwnThread):
    """Scans at most every period_s of frame time. background: in a thread, or at once where the same file must give
    the same tracks."""

    def __init__(self, net: StackNet, score_min: float, period_s: float, *, background: bool) -> None:
        super().__init__("scan", SCAN_CLOSE_S)
        self._net = net
        self._background = background
        self._score_min = score_min
        self._period_ns = round(period_s * 1e9)
        self._due_unix_ns = 0
        self._found: Array = np.zeros((0, 3))
        self._work: list[Image] | None = None
        self._changed = threading.Condition()
        self._error: ModelError | None = None
        self.scans = 0
        if background:
            self.start()

    def offer(self, t_unix_ns: int, images: list[Image]) -> None:
        """Show the newest stack; it is scanned if it is time to and no scan is running."""
        if not self._period_ns or 0 < self._due_unix_ns - t_unix_ns <= self._period_ns:
            return
        with self._changed:
            if self._work is not None:
                return
            self._due_unix_ns = t_unix_ns + self._period_ns
            if self._background:
                self._work = images
                self._changed.notify_all()
                return
        self._keep(scan(self._net, images, self._score_min))

    def take(self) -> Array:
        """The places `(N, 3)` found since the last call. Raises ModelError if the scan failed."""
        with self._changed:
            found, self._found = self._found, np.zeros((0, 3))
            if self._error is not None:
                raise self._error
        return found

    def _keep(self, places: Array) -> None:
        with self._changed:
            self._found = places
            self._work = None
            self.scans += 1

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._work is not None or self._stop.is_set())
                images = self._work
            if self._stop.is_set() or images is None:
                return
            try:
                self._keep(scan(self._net, images, self._score_min))
            except ModelError as error:
                self._error = error  # raised where the frames are worked on
                return

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()
