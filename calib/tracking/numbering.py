"""One number for each object in a camera's picture, also where its box has none that lasts.

The hazard is the box that counts detections, not objects. A detector without a tracker numbers each frame anew, or
says 0 for all; a tracker at three frames a second loses its numbers on the way; and a target is only looked for among
rays that bear one number. So a box's own number counts where it comes again, and where it does not, the nearest
detection to where an object should be goes on with that object's number.
"""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

REMEMBERED_S: Final = 1.0  # s without a detection: an object of the picture is gone
NEAR_SIGMAS: Final = 4.0  # of a detection, beyond what the object may have moved
FIRST_RAD_S: Final = 1.0  # rad/s that an object seen once may move at: 40 m/s at 40 m
TURN_RAD_S: Final = 0.3  # rad/s by which one seen twice may have changed its course in the picture
MOST_HEADS: Final = 500  # objects of one picture remembered; a detector in flood must not slow the loop


@dataclass
class _Head:
    """Where an object of the picture was last: its number, the box's own, when, pixel, and pixels a second if known."""

    number: int
    label: int
    t_s: float
    u_px: float
    v_px: float
    motion_px_s: tuple[float, float] | None = None

    def miss_px(self, t_s: float, u_px: float, v_px: float) -> float:
        """How far a pixel is from where this object should be."""
        du, dv = self.motion_px_s or (0.0, 0.0)
        after_s = t_s - self.t_s
        return math.hypot(u_px - self.u_px - du * after_s, v_px - self.v_px - dv * after_s)

    def move(self, t_s: float, u_px: float, v_px: float) -> None:
        """Go on to a new detection; one older than the last tells nothing of where it is now."""
        after_s = t_s - self.t_s
        if after_s <= 0:
            return
        self.motion_px_s = ((u_px - self.u_px) / after_s, (v_px - self.v_px) / after_s)
        self.t_s, self.u_px, self.v_px = t_s, u_px, v_px


class PictureNumbers:
    """The objects in one camera's picture. focal_px: what turns angles into pixels."""

    def __init__(self, focal_px: float) -> None:
        self._focal_px = focal_px
        self._heads: dict[int, _Head] = {}  # by our number
        self._by_label: dict[int, int] = {}
        self._next = 1

    def number(self, label: NDArray[np.int64], pixels: Array, sigma_px: Array, t_s: float) -> NDArray[np.int64]:
        """Our numbers (K,) of detections with the box's own (K,), pixels (K, 2) and one sigma (K,), seen at t_s."""
        self._forget(t_s)
        own, rows = label.tolist(), pixels.tolist()
        often = Counter(own)
        numbers = [self._by_label.get(said, 0) if said > 0 and often[said] == 1 else 0 for said in own]
        left = [k for k, number in enumerate(numbers) if not number]
        if left:
            self._continue(left, numbers, rows, sigma_px.tolist(), t_s)
        for k, (u_px, v_px) in enumerate(rows):
            numbers[k] = self._note(numbers[k], own[k] if often[own[k]] == 1 else 0, t_s, u_px, v_px)
        return np.array(numbers, np.int64)

    def shift(self, by_s: float) -> None:
        """Another network counts from another instant."""
        for head in self._heads.values():
            head.t_s += by_s

    def _continue(
        self, left: list[int], numbers: list[int], rows: list[list[float]], sigma_px: list[float], t_s: float
    ) -> None:
        """Give detections without a number that of the nearest object that no other detection has; nearest first."""
        free = [head for head in self._heads.values() if head.number not in set(numbers)]
        near = []
        for k in left:
            for head in free:
                miss_px = head.miss_px(t_s, *rows[k])
                if miss_px < self._reach_px(head, t_s) + NEAR_SIGMAS * sigma_px[k]:
                    near.append((miss_px, k, head.number))
        for _, k, number in sorted(near):
            if not numbers[k] and number not in numbers:
                numbers[k] = number

    def _reach_px(self, head: _Head, t_s: float) -> float:
        rate = FIRST_RAD_S if head.motion_px_s is None else TURN_RAD_S
        return rate * self._focal_px * abs(t_s - head.t_s)

    def _note(self, number: int, label: int, t_s: float, u_px: float, v_px: float) -> int:
        if not number:
            number, self._next = self._next, self._next + 1
            self._heads[number] = _Head(number, label, t_s, u_px, v_px)
        else:
            self._heads[number].move(t_s, u_px, v_px)
        if label > 0:
            self._call(self._heads[number], label)
        return number

    def _call(self, head: _Head, label: int) -> None:
        """The box calls an object so from now on."""
        if head.label != label and self._by_label.get(head.label) == head.number:
            del self._by_label[head.label]
        head.label = label
        self._by_label[label] = head.number

    def _forget(self, t_s: float) -> None:
        while len(self._heads) > MOST_HEADS or self._oldest_s() < t_s - REMEMBERED_S:
            number = min(self._heads, key=lambda number: self._heads[number].t_s)
            head = self._heads.pop(number)
            if self._by_label.get(head.label) == number:
                del self._by_label[head.label]

    def _oldest_s(self) -> float:
        return min((head.t_s for head in self._heads.values()), default=math.inf)
