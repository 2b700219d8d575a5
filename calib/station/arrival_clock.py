"""The clock by which messages arrive: it never steps, and yet reads as UTC in the recording."""

import time


class ArrivalClock:
    """UTC nanoseconds by the monotonic clock, set once."""

    def __init__(self) -> None:
        self._utc_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Now."""
        return time.monotonic_ns() + self._utc_ns

    def at(self, t_monotonic_ns: int) -> int:
        """The instant that the monotonic clock showed so."""
        return t_monotonic_ns + self._utc_ns
