"""A process that may not do what a service's sandbox forbids: a real seccomp filter, as systemd lays one.

It cannot be taken off again, so it is laid in a process started for it: `python -m tests.forbidden SYSCALL MODULE ...`
runs a module as `python -m` would, with that one system call answered by EPERM.
"""

import ctypes
import errno
import platform
import runpy
import struct
import sys
from typing import Final

NUMBERS: Final = {"setpriority": {"x86_64": 141, "aarch64": 140}}
NO_NEW_PRIVILEGES, SECCOMP, FILTER = 38, 22, 2  # prctl's words, linux/prctl.h
LOAD, EQUAL, RETURN = 0x20, 0x15, 0x06  # of classic BPF: the system call's number, one comparison, the verdict
ALLOW, REFUSE = 0x7FFF0000, 0x00050000 | errno.EPERM


def forbid(call: str) -> None:
    """From now on this process and its children get EPERM for it. Raises OSError where seccomp is not to be had."""
    program = b"".join(
        struct.pack("<HBBI", *instruction)
        for instruction in (
            (LOAD, 0, 0, 0),
            (EQUAL, 0, 1, NUMBERS[call][platform.machine()]),
            (RETURN, 0, 0, REFUSE),
            (RETURN, 0, 0, ALLOW),
        )
    )
    code = ctypes.create_string_buffer(program, len(program))
    header = ctypes.create_string_buffer(struct.pack("@HP", len(program) // 8, ctypes.addressof(code)))
    libc = ctypes.CDLL(None, use_errno=True)
    for words in ((NO_NEW_PRIVILEGES, 1, 0, 0, 0), (SECCOMP, FILTER, header, 0, 0)):
        if libc.prctl(*words):
            raise OSError(ctypes.get_errno(), "prctl")


if __name__ == "__main__":
    forbid(sys.argv[1])
    sys.argv = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
