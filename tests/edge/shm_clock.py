"""A reference clock in shared memory, as chrony and ntpd read it: `python shm_clock.py UNIT OFFSET_S`.

Source: ntpd's refclock_shm driver, mode 1: an even count, the times of clock and receive stamp, valid.
"""

import ctypes
import sys
import time

IPC_CREAT = 0o1000
KEY = 0x4E545030  # "NTP0"


class ShmTime(ctypes.Structure):
    """struct shmTime of refclock_shm, 64 bit."""

    _fields_ = (
        ("mode", ctypes.c_int),
        ("count", ctypes.c_int),
        ("clock_s", ctypes.c_long),
        ("clock_us", ctypes.c_int),
        ("receive_s", ctypes.c_long),
        ("receive_us", ctypes.c_int),
        ("leap", ctypes.c_int),
        ("precision", ctypes.c_int),
        ("samples", ctypes.c_int),
        ("valid", ctypes.c_int),
        ("clock_ns", ctypes.c_uint),
        ("receive_ns", ctypes.c_uint),
        ("dummy", ctypes.c_int * 8),
    )


def attach(unit: int) -> tuple[ShmTime, int]:
    """The segment of that unit, made if it is not there, and its identifier."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.shmat.restype = ctypes.c_void_p
    segment = libc.shmget(KEY + unit, ctypes.sizeof(ShmTime), IPC_CREAT | 0o666)
    if segment < 0:
        raise OSError(ctypes.get_errno(), "shmget")
    address = libc.shmat(segment, None, 0)
    return ShmTime.from_address(address), segment


def remove(segment: int) -> None:
    """Remove a segment."""
    ctypes.CDLL(None).shmctl(segment, 0, None)


def tick(shm: ShmTime, offset_s: float) -> None:
    """One sample: the reference is offset_s ahead of this machine's clock."""
    receive_ns = time.time_ns()
    clock_ns = receive_ns + round(offset_s * 1e9)
    shm.valid = 0
    shm.count += 1
    shm.mode, shm.leap, shm.precision = 1, 0, -20
    shm.clock_s, shm.clock_us, shm.clock_ns = clock_ns // 10**9, clock_ns % 10**9 // 1000, clock_ns % 10**9
    shm.receive_s, shm.receive_us, shm.receive_ns = receive_ns // 10**9, receive_ns % 10**9 // 1000, receive_ns % 10**9
    shm.count += 1
    shm.valid = 1


if __name__ == "__main__":
    memory, _ = attach(int(sys.argv[1]))
    while True:
        tick(memory, float(sys.argv[2]))
        time.sleep(0.2)
