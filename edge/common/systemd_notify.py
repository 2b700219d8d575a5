"""Telling systemd that we are ready, and that work is really being done.

A watchdog that is fed by a timer guards nothing: the timer ticks on while the camera thread hangs in its driver. So it
is fed only while everything that should move has moved. A camera that is unplugged and tried again moves too: that is
for health to tell, and no reason to be killed every half minute.
"""

import os
import socket
from collections.abc import Mapping
from typing import Final

WATCHDOG_SHARE: Final = 0.5  # of systemd's patience: how long something may stand still before we stop feeding


class Heartbeat:
    """Whether everything still moves. Pure: progress and time are handed in."""

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self._last: dict[str, tuple[float, float]] = {}  # name: progress, and when it last changed

    def beat(self, progress: Mapping[str, float], now_s: float) -> list[str]:
        """Who has stood still for too long; the watchdog may be fed when it is nobody. progress: any counters."""
        for name, value in progress.items():
            if name not in self._last or self._last[name][0] != value:
                self._last[name] = (value, now_s)
        for name in self._last.keys() - progress.keys():
            del self._last[name]
        return [name for name, (_, since_s) in self._last.items() if now_s - since_s > self._patience_s]


class Notifier:
    """systemd's notification socket; does nothing where there is none."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        path = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path.startswith("@") else path
        watchdog_us = environment.get("WATCHDOG_USEC", "") if _is_for_us(environment) else ""
        self.watchdog_s = int(watchdog_us) / 1e6 if watchdog_us.isdigit() else None
        self.heartbeat = Heartbeat(WATCHDOG_SHARE * self.watchdog_s if self.watchdog_s else 10.0)

    def ready(self, status: str = "running") -> None:
        """The service is up."""
        self._send(f"READY=1\nSTATUS={_one_line(status)}")

    def feed(self, progress: Mapping[str, float], now_s: float, status: str = "") -> list[str]:
        """Feed the watchdog if everything moved; returns what did not. Call it once a second."""
        still = self.heartbeat.beat(progress, now_s)
        lines = [] if still else ["WATCHDOG=1"]
        if status:
            lines.append(f"STATUS={_one_line(status)}")
        if lines:
            self._send("\n".join(lines))
        return still

    def stopping(self) -> None:
        """The service is going down in order."""
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if not self._address:
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            sender.setblocking(False)  # a systemd that does not read must not hold up a camera
            try:
                sender.sendto(text.encode(), self._address)
            except OSError:
                return  # not told this time; systemd is the one to act on that


def _is_for_us(environment: Mapping[str, str]) -> bool:
    return environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())


def _one_line(text: str) -> str:
    return " ".join(text.split())
