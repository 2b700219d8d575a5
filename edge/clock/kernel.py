"""The clock as the kernel tells it, where chrony is not there: whoever disciplines it left a largest error."""

import ctypes
from typing import Final

from edge.clock.state import ClockState, unknown

TIME_ERROR: Final = 5  # adjtimex(2): the clock is not synchronised
STA_UNSYNC: Final = 0x0040
STA_NANO: Final = 0x2000


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
        return unknown("kernel", "no time daemon disciplines this clock", "install and start chrony (deploy/chrony)")
    offset_s = abs(timex.offset) * (1e-9 if timex.status & STA_NANO else 1e-6)
    bound_s = offset_s + timex.maxerror * 1e-6
    return ClockState(bound_s, "kernel", True, f"the kernel says within {bound_s * 1e3:.3g} ms")


def read_kernel() -> ClockState:
    """The state as the kernel tells it. Needs no privilege: nothing is set."""
    timex = Timex()
    state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(timex))
    if state < 0:
        return unknown("kernel", f"adjtimex failed, errno {ctypes.get_errno()}", "install and start chrony")
    return of_kernel(timex, state)
