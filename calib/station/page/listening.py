"""The page's door in front of the HTTP library: each connection is counted, and what fills the log is told once.

The hazard is the library's own patience: it waits for ever for the end of a request, and logs each garbled one.
"""

import asyncio
import logging
import time
from typing import Any, Final

import uvicorn

from calib.station.page.door import Door

LIBRARY_LOGS: Final = ("uvicorn.error", "asyncio")
LINES: Final = 20  # of a library's log in LINES_S; the rest is counted
LINES_S: Final = 60.0


def stand_at(config: uvicorn.Config, door: Door) -> None:
    """Have each connection of a server pass a door, and the server's log within bounds."""
    config.load()
    config.http_protocol_class = _counted(config.http_protocol_class, door)
    for name in LIBRARY_LOGS:
        logging.getLogger(name).addFilter(RateLimit())


def _counted(library: Any, door: Door) -> type[asyncio.Protocol]:
    class CountedProtocol(library):  # type: ignore[misc]  # the library chooses one at run time
        """The library's, and the door is told who came."""

        def connection_made(self, transport: asyncio.Transport) -> None:
            super().connection_made(transport)
            peer = transport.get_extra_info("peername") or ("", 0)
            door.came((str(peer[0]), int(peer[1])), transport, time.monotonic())

    return CountedProtocol


class RateLimit(logging.Filter):
    """Lets so many lines a minute through, and says how many it did not."""

    def __init__(self) -> None:
        super().__init__()
        self._since_s = -LINES_S
        self._lines = self._held_back = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether this line is logged."""
        now_s = time.monotonic()
        if now_s - self._since_s >= LINES_S:
            if self._held_back:
                record.msg, record.args = f"{record.getMessage()} ({self._held_back} lines left out before)", ()
            self._since_s, self._lines, self._held_back = now_s, 0, 0
        self._lines += 1
        self._held_back += self._lines > LINES
        return self._lines <= LINES
