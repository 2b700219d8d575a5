"""`base-station` with a wall clock that is behind, until SIGUSR1 sets it right: an hour gone by in an instant.

    python -m tools.doubles.late_clock SECONDS run --config base.toml

What tells UTC is shifted, and time.monotonic goes on by as much when it is set right: a leap of UTC alone is not an
hour gone by, and is not believed for a while (signing_time.py). Sockets, Zenoh and time.monotonic_ns go on as they are.
"""

import signal
import sys
import time

from calib.station.app import main


class LateClock:
    """UTC as this process believes it, and how long it believes to have run."""

    def __init__(self, behind_s: float) -> None:
        self._behind_ns, self._gone_s = round(behind_s * 1e9), 0.0
        self._real_ns, self._real_monotonic = time.time_ns, time.monotonic

    def set_right(self, *_: object) -> None:
        """The time that was lacking has gone by."""
        self._behind_ns, self._gone_s = 0, self._gone_s + self._behind_ns * 1e-9

    def monotonic(self) -> float:
        """As time.monotonic."""
        return self._real_monotonic() + self._gone_s

    def time_ns(self) -> int:
        """As time.time_ns."""
        return self._real_ns() - self._behind_ns

    def time(self) -> float:
        """As time.time."""
        return self.time_ns() * 1e-9


if __name__ == "__main__":
    clock = LateClock(float(sys.argv[1]))
    signal.signal(signal.SIGUSR1, clock.set_right)
    time.time_ns, time.time, time.monotonic = clock.time_ns, clock.time, clock.monotonic
    sys.exit(main(sys.argv[2:]))
