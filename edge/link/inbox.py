"""Where messages wait between the network's threads and ours: bounded, oldest out first, and counted.

A slow reader must never push back: when Zenoh's own queue behind a callback fills, its receiving thread stops and every
other subscriber of the session starves. So a callback only puts, a full inbox forgets its oldest item, and says so.
"""

import threading
import time
from collections import deque
from typing import Generic, NamedTuple, TypeVar


class Received(NamedTuple):
    """One message as it came: its key (which says who wrote it), its bytes, and when it arrived here."""

    key: str
    payload: bytes
    t_monotonic_ns: int


class Presence(NamedTuple):
    """A liveliness token that appeared or vanished, and when that was noticed here."""

    key: str
    alive: bool
    t_monotonic_ns: int


Item = TypeVar("Item")


class Inbox(Generic[Item]):
    """A bounded queue between threads. `put` never blocks; the oldest item goes when it is full."""

    def __init__(self, capacity: int, bell: threading.Event | None = None) -> None:
        """capacity: most items kept. bell: set at every arrival, so one reader can wait for many inboxes."""
        self._items: deque[Item] = deque()
        self._capacity = capacity
        self._changed = threading.Condition()
        self._bell = bell
        self._received = 0
        self._dropped = 0

    @property
    def received(self) -> int:
        """How many items ever arrived."""
        return self._received

    @property
    def dropped(self) -> int:
        """How many were forgotten unread because the reader was too slow."""
        return self._dropped

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item) -> None:
        """Add an item; forget the oldest if there is no room."""
        with self._changed:
            self._received += 1
            if len(self._items) >= self._capacity:
                self._items.popleft()
                self._dropped += 1
            self._items.append(item)
            self._changed.notify()
        if self._bell is not None:
            self._bell.set()

    def get(self, timeout_s: float = 0.0) -> Item | None:
        """The oldest item, waiting up to timeout_s for one; None if there is none."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while not self._items:
                left = deadline - time.monotonic()
                if left <= 0 or not self._changed.wait(left):
                    break
            return self._items.popleft() if self._items else None

    def drain(self, at_most: int | None = None) -> list[Item]:
        """All items waiting, or the oldest of them, in the order they came, without waiting for more."""
        with self._changed:
            count = len(self._items) if at_most is None else min(at_most, len(self._items))
            return [self._items.popleft() for _ in range(count)]
