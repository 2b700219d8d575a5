"""What systemd does to a service of Type=notify with a watchdog: a socket, and patience."""

import os
import socket
import time
from pathlib import Path
from types import TracebackType
from typing import Self


class Supervisor:
    """Listens on a real notification socket."""

    def __init__(self, folder: Path, watchdog_s: float) -> None:
        self._path = folder / "notify"
        self._watchdog_s = watchdog_s
        self.told: list[tuple[float, str]] = []  # when (monotonic), one line

    def __enter__(self) -> Self:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self._path))
        self._socket.settimeout(0.1)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()

    @property
    def environment(self) -> dict[str, str]:
        """What the service is started with; without WATCHDOG_PID, as its process is not known yet."""
        watchdog = str(round(self._watchdog_s * 1e6))
        return {**os.environ, "NOTIFY_SOCKET": str(self._path), "WATCHDOG_USEC": watchdog}

    def listen(self, seconds: float) -> list[str]:
        """The lines told within a while."""
        began, first = time.monotonic(), len(self.told)
        while time.monotonic() - began < seconds:
            try:
                lines = self._socket.recv(4096).decode().splitlines()
            except TimeoutError:
                continue
            self.told += [(time.monotonic(), line) for line in lines]
        return [line for _, line in self.told[first:]]

    def wait_for(self, line: str, within_s: float) -> bool:
        """Whether a line was told, in the past or within a while."""
        deadline = time.monotonic() + within_s
        while not any(told == line for _, told in self.told):
            if time.monotonic() > deadline:
                return False
            self.listen(0.1)
        return True
