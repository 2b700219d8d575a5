"""Targets that one camera alone goes on seeing: they keep their number while nobody knows how far away they are.

The hazard is a range that comes from nowhere. One camera measures a direction; a filter that is linearised again and
again about its own guess of the range grows sure of it, and of a wrong one. So a target that has become more uncertain
than is of use is no longer filtered. It keeps its number with the camera and the object in that camera's picture, says
no position, and when a new target is found from that object's rays and another camera's, that is the old one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.tracking.estimates import TargetEstimate


@dataclass(eq=False)
class _Lone:
    track: int
    camera: str
    label: int
    seen_s: float
    farewell: TargetEstimate


class LoneTargets:
    """Targets without a position, by the camera that sees them, with what is said of one that is lost for good."""

    def __init__(self) -> None:
        self._all: list[_Lone] = []

    def __len__(self) -> int:
        return len(self._all)

    def __contains__(self, track: int) -> bool:
        return any(lone.track == track for lone in self._all)

    def keep(self, track: int, seen_by: tuple[str, int], seen_s: float, farewell: TargetEstimate) -> None:
        """A target's position is of no use any more; seen_by: camera, and the object's number in its picture."""
        camera, label = seen_by
        self._all.append(_Lone(track, camera, label, seen_s, farewell))

    def note(self, camera: str, label: NDArray[np.int64], t_s: float) -> None:
        """A camera sees these objects (K,) at t_s."""
        for lone in self._all:
            if lone.camera == camera and (label == lone.label).any():
                lone.seen_s = max(lone.seen_s, t_s)

    def heir(self, seen_by: set[tuple[str, int]]) -> int | None:
        """The number of the target whose object a new one was found from, which is no longer alone; None if of none."""
        for lone in self._all:
            if (lone.camera, lone.label) in seen_by:
                self._all.remove(lone)
                return lone.track
        return None

    def end(self, before_s: float, camera: str | None = None) -> list[TargetEstimate]:
        """Farewells of those last seen before an instant, by that camera or any."""
        ended = [lone for lone in self._all if lone.seen_s < before_s and camera in (None, lone.camera)]
        self._all = [lone for lone in self._all if lone not in ended]
        return [lone.farewell for lone in ended]

    def shift(self, by_s: float) -> None:
        """Another network counts from another instant."""
        for lone in self._all:
            lone.seen_s += by_s
