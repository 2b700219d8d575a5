"""What time it is in the data: the stations' "now", live and in a replay of years ago alike.

The hazard is the wall clock. A recording played again carries its own old stamps, perhaps ten times too fast, so the
station never asks how old a stamp is by its own clock. Each frame says by how much its camera's stamps lead or trail
the arrival clock; the median over the cameras whose frames came lately is the stream's offset, and "now" is the
arrival clock plus that offset. One camera whose clock is years off cannot move the median of three; it is found by it
instead. When all cameras fall silent, "now" goes on with the arrival clock, so that targets age and are lost.
"""

from statistics import median_low
from typing import Final

from edge.common.units import NS

RECENT_NS: Final = 5_000_000_000  # arrival time; a camera silent for longer does not count
AHEAD_S: Final = 2.0  # more than any latency: such a stamp is from a clock that is wrong
MANY: Final = 12  # cameras, beyond which one of them moves the median by nothing that matters
ANEW_NS: Final = 50_000_000  # arrival time between two looks at all of many cameras: clocks drift slower


class StreamClock:
    """The offset of the data's time against the arrival clock."""

    def __init__(self) -> None:
        self._offsets: dict[str, tuple[int, int]] = {}  # camera: stamp minus arrival, arrival
        self._typical, self._typical_ns = 0, 0  # offset of many cameras, and when it was found

    def ahead_s(self, camera: str, t_unix_ns: int, now_ns: int) -> float:
        """By how many seconds a frame's stamp is ahead of the other cameras' (negative: behind); 0 without others."""
        if len(self._offsets) > MANY:
            return (t_unix_ns - now_ns - self._of_many(now_ns)) / NS
        others = self._recent(now_ns, but=camera)
        return (t_unix_ns - now_ns - median_low(others)) / NS if others else 0.0

    def _of_many(self, now_ns: int) -> int:
        if not 0 <= now_ns - self._typical_ns < ANEW_NS:
            offsets = self._recent(now_ns) or [offset for offset, _ in self._offsets.values()]
            self._typical, self._typical_ns = median_low(offsets), now_ns
        return self._typical

    def add(self, camera: str, t_unix_ns: int, now_ns: int) -> None:
        """Take the stamp of a frame that was accepted."""
        self._offsets[camera] = (t_unix_ns - now_ns, now_ns)

    def now_unix_ns(self, now_ns: int) -> int | None:
        """The instant of the data at an instant of the arrival clock; None before any frame came."""
        offsets = self._recent(now_ns) or [offset for offset, _ in self._offsets.values()]
        return now_ns + median_low(offsets) if offsets else None

    def _recent(self, now_ns: int, but: str = "") -> list[int]:
        return [
            offset
            for camera, (offset, arrived_ns) in self._offsets.items()
            if camera != but and now_ns - arrived_ns < RECENT_NS
        ]
