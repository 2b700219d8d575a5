"""`base-station` with a wall clock that is behind, until SIGUSR1 sets it right: an hour gone by in an instant.

    python -m tools.doubles.late_clock SECONDS run --config base.toml

Only what tells UTC is shifted; the monotonic clock, sockets and Zenoh go on as they are.
"""

import signal
import sys
import time

from calib.station.app import main


class LateClock:
    """UTC as this process believes it."""

    def __init__(self, behind_s: float) -> None:
        self._behind_ns = round(behind_s * 1e9)
        self._real_ns = time.time_ns

    def set_right(self, *_: object) -> None:
        """The clock is right from now on."""
        self._behind_ns = 0

    def time_ns(self) -> int:
        """As time.time_ns."""
        return self._real_ns() - self._behind_ns

    def time(self) -> float:
        """As time.time."""
        return self.time_ns() * 1e-9


if __name__ == "__main__":
    clock = LateClock(float(sys.argv[1]))
    signal.signal(signal.SIGUSR1, clock.set_right)
    time.time_ns, time.time = clock.time_ns, clock.time
    sys.exit(main(sys.argv[2:]))
