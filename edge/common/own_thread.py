"""A thread that belongs to somebody: started when its owner is entered, told to stop and joined when it is left.

A thread that nobody joins tears at what it uses while the process goes down; one that is waited for without an end
keeps the process from going down at all. So every owner says how long it is waited for, and what wakes it.
"""

import logging
import sys
import threading
from abc import ABC, abstractmethod
from types import TracebackType
from typing import Final, Self

log = logging.getLogger(__name__)

GIVE_WAY_S: Final = 0.0005  # after which a computing thread lets another in; Python's own 5 ms show in every latency


def give_way_soon() -> None:
    """Have no thread of this process keep what is live waiting for long. For the beginning of a program."""
    sys.setswitchinterval(GIVE_WAY_S)


class OwnThread(ABC):
    """Base of what has one thread of its own: give it `_run`, which ends soon after `_stop` is set."""

    def __init__(self, name: str, close_s: float) -> None:
        """close_s: its share of the 3 s in which a program must be down."""
        self._name = name
        self._close_s = close_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def start(self) -> None:
        """Begin; for an owner that is no context manager, who then has to `close`."""
        self._thread.start()

    def ask_to_stop(self) -> None:
        """Tell the thread to end and do not wait: for an owner of several, which are then waited for together."""
        self._stop.set()
        self._wake()

    def join(self, timeout_s: float) -> bool:
        """Wait for the thread's end; False if it hangs in something, a driver say. True if it was never started."""
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    @property
    def ended(self) -> bool:
        """Whether the thread was started and is done."""
        return self._thread.ident is not None and not self._thread.is_alive()

    def close(self) -> None:
        """Stop in order; returns within the time it was given, whatever the thread hangs in."""
        self.ask_to_stop()
        if not self.join(self._close_s):
            log.warning("%s: not done within %.1f s; left to the process's end", self._name, self._close_s)

    @abstractmethod
    def _run(self) -> None:
        """The thread's work."""

    def _wake(self) -> None:  # noqa: B027 -- most have nothing else to wait for
        """Rouse the thread from whatever it waits for, besides `_stop`."""
