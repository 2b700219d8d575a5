"""Whether the camera still looks where it looked: a bump moves the whole picture at once.

A tripod that is knocked makes every later position wrong, and nothing in the tracks of one camera shows it. The whole
picture shows it: it shifts between one look and the next. Clouds shift too, but by a fraction of a pixel in so short a
time, so only looks that are close together are compared. An even sky says nothing, and nothing is concluded from it.
"""

from collections import deque
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image, Picture
from edge.capture.grey import grey
from edge.detector.motion import halved

LOOK_NS: Final = 500_000_000  # ns between looks: a knock is over in less, and clouds move little
VIEW_WIDTH_PX: Final = 480  # the reduced picture's, at the least: the correlation then finds 0.1 px, 0.4 px at 1920
SHIFT_PX: Final = 1.0  # of the reduced picture: 4 px at 1920, ten times what clouds do between looks
CLEAR: Final = 0.15  # response of the correlation below which there is no common picture to speak of
BLOCKS: Final = (6, 8)  # rows and columns that the picture is cut into, to ask each whether it moved
VOTE_GREY: Final = 0.3  # grey levels, mean of a block, that one answer must fit better: three times its noise
VOTE_SHARE: Final = 0.3  # and this share of what it is off
REMEMBERED_NS: Final = 60_000_000_000  # ns for which a shift is worth telling
MOVING_LOOKS: Final = 4  # shifts among the last REMEMBERED_NS that make it a camera that moves


@dataclass(frozen=True)
class Shift:
    """The picture moved by du, dv pixels (of the frame) between two looks, the later at t_unix_ns."""

    t_unix_ns: int
    du_px: float
    dv_px: float


class ViewWatch:
    """Compares the picture with itself half a second earlier. Pure: frames bring their time."""

    def __init__(self) -> None:
        self._last: tuple[int, int, NDArray[np.float32]] | None = None  # time, segment, reduced picture
        self._window: NDArray[np.float32] | None = None
        self.recent: deque[Shift] = deque()
        self.shifts = 0

    def update(self, frame: Picture) -> Shift | None:
        """The shift since the last look, if there was one; looks at most every LOOK_NS."""
        last = self._last
        if last is not None and last[1] == frame.segment and 0 <= frame.t_unix_ns - last[0] < LOOK_NS:
            return None
        small = _reduced(grey(frame.image))
        self._last = (frame.t_unix_ns, frame.segment, small)
        while self.recent and self.recent[0].t_unix_ns < frame.t_unix_ns - REMEMBERED_NS:
            self.recent.popleft()
        if last is None or last[2].shape != small.shape:
            return None
        return self._compare(last[2], small, frame)

    def _compare(self, before: NDArray[np.float32], now: NDArray[np.float32], frame: Picture) -> Shift | None:
        if self._window is None or self._window.shape != now.shape:
            self._window = cv2.createHanningWindow((now.shape[1], now.shape[0]), cv2.CV_32F)
        (du, dv), response = cv2.phaseCorrelate(before.copy(), now.copy(), self._window)  # it multiplies them in place
        if response < CLEAR or max(abs(du), abs(dv)) < SHIFT_PX or not all_moved(before, now, (du, dv)):
            return None
        scale = frame.image.shape[1] / now.shape[1]
        shift = Shift(frame.t_unix_ns, du * scale, dv * scale)
        self.recent.append(shift)
        self.shifts += 1
        return shift

    @property
    def moves(self) -> bool:
        """Whether the picture shifts again and again, as on a moving camera."""
        return len(self.recent) >= MOVING_LOOKS


def all_moved(before: NDArray[np.float32], now: NDArray[np.float32], shift_px: tuple[float, float]) -> bool:
    """Whether the picture moved, or one thing in it: blocks vote, and those for the move must lie far apart.

    On an open sky the flying object is all that a correlation sees. Its own blocks fit the move; those of a treeline
    do not, and those of the even sky say nothing.
    """
    height, width = now.shape
    moved = cv2.warpAffine(before, np.array([[1, 0, shift_px[0]], [0, 1, shift_px[1]]]), (width, height))
    inside = cv2.warpAffine(np.ones_like(before), np.array([[1, 0, shift_px[0]], [0, 1, shift_px[1]]]), (width, height))
    stayed_off = _block_means(cv2.absdiff(now, before) * inside)
    moved_off = _block_means(cv2.absdiff(now, moved) * inside)
    gained = stayed_off - moved_off
    clear = np.maximum(VOTE_GREY, VOTE_SHARE * np.maximum(stayed_off, moved_off))
    rows, columns = np.nonzero(gained > clear)
    against = int(np.count_nonzero(-gained > clear))
    if len(rows) <= 2 * against:
        return False
    return bool(np.ptp(columns) >= BLOCKS[1] // 2 or np.ptp(rows) >= BLOCKS[0] // 2)


def _block_means(image: NDArray[np.float32]) -> NDArray[np.float32]:
    means: NDArray[np.float32] = cv2.resize(image, (BLOCKS[1], BLOCKS[0]), interpolation=cv2.INTER_AREA)
    return means


def _reduced(image: Image) -> NDArray[np.float32]:
    """The picture halved as often as leaves it VIEW_WIDTH_PX wide: halving alone is cheap."""
    while image.shape[1] >= 2 * VIEW_WIDTH_PX:
        image = halved(image)
    return image.astype(np.float32)
