"""The frames of the last fraction of a second, found by time.

Motion and the network's stack of frames compare the present with 100 and 200 ms ago. Counted in frames that would mean
something else on every camera and after every drop; so the past is asked for by time.
"""

from collections import deque
from typing import Final

from edge.capture.frame import Image, Picture

SLACK: Final = 1.5  # kept beyond the furthest offset, so that a late frame still finds its reference
COMPLETE: Final = 0.8  # of the furthest offset: frames do not fall exactly on it
LONGEST_GAP_NS: Final = 1_000_000_000  # ns: after such a silence the past says nothing about motion


class History:
    """Recent frames of one camera. offsets_s: how long ago, each, such as (0.1, 0.2)."""

    def __init__(self, offsets_s: tuple[float, ...]) -> None:
        self._offsets_ns = tuple(round(offset * 1e9) for offset in offsets_s)
        self._frames: deque[Picture] = deque()

    def push(self, frame: Picture) -> bool:
        """Add the newest frame. True if the past was forgotten: another segment, size, or a gap or step in time."""
        forgotten = bool(self._frames) and not self._continues(frame)
        if forgotten:
            self._frames.clear()
        self._frames.append(frame)
        while self._frames[0].t_unix_ns < frame.t_unix_ns - max(self._offsets_ns) * SLACK:
            self._frames.popleft()
        return forgotten

    def _continues(self, frame: Picture) -> bool:
        last = self._frames[-1]
        in_order = 0 < frame.t_unix_ns - last.t_unix_ns < LONGEST_GAP_NS
        return in_order and frame.segment == last.segment and frame.image.shape == last.image.shape

    @property
    def complete(self) -> bool:
        """Whether it reaches back far enough to tell motion from its own beginning."""
        return self._frames[-1].t_unix_ns - self._frames[0].t_unix_ns >= COMPLETE * max(self._offsets_ns)

    def past(self) -> list[Image]:
        """The images nearest in time to each offset before the newest; the oldest there is where history is short."""
        now = self._frames[-1].t_unix_ns
        return [
            min(self._frames, key=lambda frame: abs(now - offset - frame.t_unix_ns)).image
            for offset in self._offsets_ns
        ]
