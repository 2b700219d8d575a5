"""What systemd is told: ready, alive, stopping. Without systemd, nothing.

The hazard is a watchdog fed by a thread that lives on while the loop hangs; so it is fed from the loop alone.
"""

import os
import socket
import time
from typing import Final

EVERY_S: Final = 1.0  # between watchdog notes; the unit's WatchdogSec is many times that
_last = 0.0


def ready() -> None:
    """The station runs."""
    _tell("READY=1")


def alive() -> None:
    """The loop has made a turn."""
    global _last  # noqa: PLW0603 -- one process, one loop, one watchdog
    if time.monotonic() - _last >= EVERY_S:
        _last = time.monotonic()
        _tell("WATCHDOG=1")


def stopping() -> None:
    """The station is on its way out."""
    _tell("STOPPING=1")


def _tell(words: str) -> None:
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as line:
        try:
            line.sendto(words.encode(), "\0" + address[1:] if address.startswith("@") else address)
        except OSError:
            return  # systemd is busy or gone: nobody to tell
