"""What "now" is among cameras whose frames come by different ways: what at least two of them have come to.

The hazard is the newest stamp. If it decides what is late, one box whose clock is a second ahead makes all others late
for ever, and every position stops, though it sees nothing itself. So "now" is the second newest of the cameras' times:
a single camera, whatever it says, moves it by no more than another one confirms. Its own frames from beyond wait until
the others have come as far; they are few, and they are let go where too many wait. When nobody else speaks any more,
nobody contradicts: the last camera that is left says what "now" is.
"""

import math
from collections import deque
from typing import Final

from calib.observations import Frame

# s of site time: a camera so far behind the newest is gone, and confirms nothing. More than a stamp may lead the others
# before the intake refuses it (stream_clock.AHEAD_S), so that no camera declares all others gone.
GONE_S: Final = 3.0
# s that a camera must have gone on by itself before the others count as silent: links stall for less.
ALONE_S: Final = 1.0
# s that one frame counts for in this: a clock that jumps ahead gains nothing, no box in a hurry is alone among others.
MOST_STEP_S: Final = 0.05
MOST_WAITING: Final = 600  # frames: five seconds of the fastest camera, longer than any may be ahead


class CommonNow:
    """The cameras' newest times, site time in s, and the frames that wait."""

    def __init__(self) -> None:
        self._newest_s: dict[str, float] = {}
        self._waiting: deque[tuple[float, Frame]] = deque(maxlen=MOST_WAITING)
        self._last: str | None = None
        self._alone_s = 0.0
        self.now_s = -math.inf

    def note(self, camera: str, t_s: float) -> None:
        """A frame of this camera came."""
        before_s = self._newest_s.get(camera, -math.inf)
        self._newest_s[camera] = max(before_s, t_s)
        self._count_alone(camera, t_s - before_s)
        first = max(self._newest_s.values())
        there = sorted(newest_s for newest_s in self._newest_s.values() if newest_s > first - GONE_S)
        self.now_s = max(self.now_s, there[-1] if self._alone_s > ALONE_S else there[-2:][0])

    def _count_alone(self, camera: str, step_s: float) -> None:
        if camera != self._last:
            self._last, self._alone_s = camera, 0.0
        else:
            self._alone_s += min(max(step_s, 0.0), MOST_STEP_S)

    def leads(self, camera: str, by_s: float) -> bool:
        """Whether a camera's stamps lead what the others have come to by more than by_s: nobody bears them out."""
        return self._newest_s.get(camera, -math.inf) > self.now_s + by_s

    def hold(self, frame: Frame, t_s: float) -> bool:
        """Keep a frame from beyond until `due`; whether none had to be let go for it."""
        full = len(self._waiting) == MOST_WAITING
        self._waiting.append((t_s, frame))
        return not full

    def due(self, until_s: float) -> list[Frame]:
        """The frames that wait no longer, in the order in which they came."""
        if not self._waiting:
            return []
        ready = [frame for t_s, frame in self._waiting if t_s <= until_s]
        self._waiting = deque(((t_s, frame) for t_s, frame in self._waiting if t_s > until_s), MOST_WAITING)
        return ready

    def shift(self, by_s: float) -> None:
        """Another network counts from another instant."""
        self._newest_s = {camera: newest_s + by_s for camera, newest_s in self._newest_s.items()}
        self._waiting = deque(((t_s + by_s, frame) for t_s, frame in self._waiting), MOST_WAITING)
        self.now_s += by_s
