"""How good this machine's UTC is, asked every few seconds of whoever disciplines it.

The hazard is the clock that nobody disciplines. At 20 m/s ten milliseconds are 0.2 m, and a machine whose time daemon
died an hour ago looks like any other. So the bound is asked of whoever disciplines the clock: chrony's |offset| + root
dispersion + half the root delay, the kernel's maximum error where chrony is not there, or ptp4l's offset and path delay
where PTP is configured. NMEA over a serial line never sets a camera's clock: it is 10 to 700 ms late; it only serves to
notice a clock that is seconds off.
"""

from dataclasses import replace
from typing import Final

from edge.clock.chrony import read_chrony
from edge.clock.client import ASK_TIMEOUT_S
from edge.clock.kernel import read_kernel
from edge.clock.ptp import read_ptp
from edge.clock.settings import ClockConfig
from edge.clock.state import ClockState
from edge.common.own_thread import OwnThread
from edge.common.utc import Dated, UtcMapping

STATE_PERIOD_S: Final = 4.0  # chrony's own shortest polling intervals are of this order
REFRESH_PERIOD_S: Final = 1.0  # a clock slewed at 100 ppm moves 0.1 ms meanwhile, and the mapping interpolates
CLOCK_CLOSE_S: Final = ASK_TIMEOUT_S + 0.5  # a question under way is waited for


def read_clock(config: ClockConfig) -> ClockState:
    """The state from the source the configuration names; auto: chrony if it runs, else the kernel."""
    if config.source == "assumed":
        return ClockState(config.assumed_bound_s, "assumed", True, f"assumed within {config.assumed_bound_s} s")
    if config.source == "ptp":
        return read_ptp()
    return read_chrony() or read_kernel()


class ClockMonitor(OwnThread):
    """Keeps the bound and the mapping fresh in a thread of its own."""

    def __init__(self, config: ClockConfig) -> None:
        super().__init__("clock", CLOCK_CLOSE_S)
        self._config = config
        self.mapping = UtcMapping()
        self._state = replace(read_clock(config), steps=0)

    def state(self) -> ClockState:
        """The latest state."""
        return replace(self._state, steps=self.mapping.steps)

    def bound_s(self) -> float | None:
        """The latest bound, for every message."""
        return self._state.bound_s

    def date(self, monotonic_ns: int) -> Dated:
        """UTC of a monotonic stamp of just now, and how far a step makes it doubtful."""
        return self.mapping.date(monotonic_ns)

    def _run(self) -> None:
        ticks = 0
        while not self._stop.wait(REFRESH_PERIOD_S):
            steps = self.mapping.steps
            self.mapping.refresh()
            ticks += 1
            # A step says that the bound was wrong: ask again at once.
            if self.mapping.steps != steps or ticks * REFRESH_PERIOD_S >= STATE_PERIOD_S:
                self._state = read_clock(self._config)
                ticks = 0
