"""How good this box's UTC is: a bound that is true, or the admission that there is none.

The hazard is the clock that nobody disciplines. At 20 m/s ten milliseconds are 0.2 m, and a box whose time daemon died
an hour ago looks like any other. So the bound is asked of whoever disciplines the clock, every few seconds: chrony's
|offset| + root dispersion + half the root delay, the kernel's maximum error where chrony is not there, or ptp4l's
offset and path delay where PTP is configured. NMEA over a serial line never sets a camera's clock: it is 10 to 700 ms
late; it only serves to notice a clock that is seconds off.
"""

import ctypes
import math
import re
import subprocess
from dataclasses import dataclass, replace
from typing import Final, Literal

from edge.common.health import Check
from edge.common.own_thread import OwnThread
from edge.common.utc import UtcMapping
from edge.config import ClockConfig

ASK_TIMEOUT_S: Final = 2.0  # chronyc and pmc answer in milliseconds or not at all
STATE_PERIOD_S: Final = 4.0  # chrony's own shortest polling intervals are of this order
REFRESH_PERIOD_S: Final = 1.0  # a clock slewed at 100 ppm moves 0.1 ms meanwhile, and the mapping interpolates
CLOCK_CLOSE_S: Final = ASK_TIMEOUT_S + 0.5  # a question under way is waited for
PTP_FLOOR_S: Final = 1e-5  # software time stamps and phc2sys add up to this

TIME_ERROR: Final = 5  # adjtimex(2): the clock is not synchronised
STA_UNSYNC: Final = 0x0040
STA_NANO: Final = 0x2000

Source = Literal["chrony", "kernel", "ptp", "assumed", "none"]


@dataclass(frozen=True)
class ClockState:
    """How far this box's UTC may be off: bound_s, None if nobody knows. reason and action are for the operator."""

    bound_s: float | None
    source: Source
    synced: bool
    reason: str
    action: str = ""
    steps: int = 0


def of_chrony(tracking: str) -> ClockState:
    """The state in one line of `chronyc -c tracking`.

    Bound as ClockBound (Amazon, 2021) computes it: |system offset| + root dispersion + root delay / 2.
    """
    fields = tracking.strip().split(",")
    try:
        name, offset_s, delay_s, dispersion_s = fields[1], float(fields[4]), float(fields[10]), float(fields[11])
        leap = fields[13]
    except (IndexError, ValueError):
        return _unknown("chrony", f"chronyc said {tracking.strip()[:80]!r}", "check that chronyd and chronyc match")
    if leap == "Not synchronised":
        return _unknown("chrony", "chronyd has no source it trusts", "check its sources: chronyc sources -v")
    bound_s = abs(offset_s) + dispersion_s + delay_s / 2
    if not (math.isfinite(bound_s) and dispersion_s >= 0 and delay_s >= 0):
        return _unknown("chrony", f"chronyc said {tracking.strip()[:80]!r}", "restart chronyd")
    return ClockState(bound_s, "chrony", True, f"chrony follows {name or fields[0]} within {bound_s * 1e3:.3g} ms")


def read_chrony(*options: str) -> ClockState | None:
    """The state as chronyd tells it; None if there is no chronyd. options: as chronyc's, such as -p PORT."""
    answer = _ask("chronyc", *options, "-c", "-n", "tracking")
    return of_chrony(answer) if answer is not None else None


class Timex(ctypes.Structure):
    """struct timex of adjtimex(2), 64 bit."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("constant", ctypes.c_long),
        ("precision", ctypes.c_long),
        ("tolerance", ctypes.c_long),
        ("time", ctypes.c_long * 2),
        ("tick", ctypes.c_long),
        ("rest", ctypes.c_long * 14),
    )


def of_kernel(timex: Timex, state: int) -> ClockState:
    """The state in what adjtimex(2) returned; maxerror in microseconds grows by 500 ppm until a daemon resets it."""
    if state == TIME_ERROR or timex.status & STA_UNSYNC:
        return _unknown("kernel", "no time daemon disciplines this clock", "install and start chrony (deploy/chrony)")
    offset_s = abs(timex.offset) * (1e-9 if timex.status & STA_NANO else 1e-6)
    bound_s = offset_s + timex.maxerror * 1e-6
    return ClockState(bound_s, "kernel", True, f"the kernel says within {bound_s * 1e3:.3g} ms")


def read_kernel() -> ClockState:
    """The state as the kernel tells it. Needs no privilege: nothing is set."""
    timex = Timex()
    state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(timex))
    if state < 0:
        return _unknown("kernel", f"adjtimex failed, errno {ctypes.get_errno()}", "install and start chrony")
    return of_kernel(timex, state)


def of_ptp(answer: str) -> ClockState:
    """The state in the answer of pmc to GET TIME_STATUS_NP and GET CURRENT_DATA_SET; offsets there are nanoseconds."""
    reported = dict(re.findall(r"^\s+(\w+)\s+(\S+)\s*$", answer, flags=re.MULTILINE))
    try:
        present = reported["gmPresent"] == "true"
        bound_s = (abs(float(reported["offsetFromMaster"])) + float(reported["meanPathDelay"]) / 2) * 1e-9 + PTP_FLOOR_S
    except (KeyError, ValueError):
        return _unknown("ptp", "ptp4l did not answer", "start ptp4l, and let this user write to /var/run/ptp4l")
    if not math.isfinite(bound_s):
        return _unknown("ptp", "ptp4l gave no number", "restart ptp4l")
    if not present:
        return _unknown("ptp", "no PTP grandmaster on this network", "check the grandmaster and the switch")
    return ClockState(bound_s, "ptp", True, f"PTP within {bound_s * 1e6:.3g} us of the grandmaster")


def read_ptp() -> ClockState:
    """The state as ptp4l tells it. It is the bound of the hardware clock: phc2sys must carry it to the system's."""
    return of_ptp(_ask("pmc", "-u", "-b", "0", "GET TIME_STATUS_NP", "GET CURRENT_DATA_SET") or "")


def read_clock(config: ClockConfig) -> ClockState:
    """The state from the source the configuration names; auto: chrony if it runs, else the kernel."""
    if config.source == "assumed":
        return ClockState(config.assumed_bound_s, "assumed", True, f"assumed within {config.assumed_bound_s} s")
    if config.source == "ptp":
        return read_ptp()
    return read_chrony() or read_kernel()


def check_clock(state: ClockState, limit_s: float) -> Check:
    """What the operator sees: a failure over the limit or without a bound."""
    if state.bound_s is None:
        return Check("clock", "fail", state.reason, state.action)
    if state.bound_s > limit_s:
        reason = f"UTC may be {state.bound_s * 1e3:.3g} ms off, the limit is {limit_s * 1e3:g} ms: {state.reason}"
        return Check("clock", "fail", reason, "wait, or give the box a better source of time")
    if state.source == "assumed":
        return Check("clock", "warn", state.reason, 'set clock.source = "auto" and run chrony')
    return Check("clock", "ok", state.reason)


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

    def unix_ns(self, monotonic_ns: int) -> int:
        """UTC of a monotonic stamp."""
        return self.mapping.unix_ns(monotonic_ns)

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


def _ask(*command: str) -> str | None:
    """What a time daemon's client prints; None if it is not installed, fails or does not answer."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=ASK_TIMEOUT_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout if done.returncode == 0 else None


def _unknown(source: Source, reason: str, action: str) -> ClockState:
    return ClockState(None, source, False, reason, action)
