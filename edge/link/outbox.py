"""Live messages on their way to the link's thread: bounded, oldest out first, and never stale.

A message that waited for more than a second is thrown away and counted: stale live data only delays what is new, and
the spool has kept it.
"""

import threading
import time
from collections import deque
from typing import Final, NamedTuple

OUTBOX_MESSAGES: Final = 256  # messages; about 3 s of two cameras at 30 Hz
STALE_NS: Final = 1_000_000_000


class OutgoingMessage(NamedTuple):
    """One message to be sent."""

    key: str
    payload: bytes
    t_monotonic_ns: int


class Outbox:
    """What waits to be sent. Not a lock of its own: the link's condition guards it and is told of every put."""

    def __init__(self, changed: threading.Condition) -> None:
        self._changed = changed
        self._items: deque[OutgoingMessage] = deque()
        self.dropped = 0
        self.stale = 0

    def __len__(self) -> int:
        return len(self._items)

    def put(self, key: str, payload: bytes) -> None:
        """Add a message; forget the oldest if there is no room."""
        with self._changed:
            if len(self._items) >= OUTBOX_MESSAGES:
                self._items.popleft()
                self.dropped += 1
            self._items.append(OutgoingMessage(key, payload, time.monotonic_ns()))
            self._changed.notify_all()

    def take(self) -> list[OutgoingMessage]:
        """All that is still worth sending, oldest first. The caller holds the condition."""
        oldest_ns = time.monotonic_ns() - STALE_NS
        fresh = [item for item in self._items if item.t_monotonic_ns >= oldest_ns]
        self.stale += len(self._items) - len(fresh)
        self._items.clear()
        return fresh
