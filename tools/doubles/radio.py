"""The far end of a serial line, a radio or an autopilot, that can stop taking bytes."""

import contextlib
import os
import threading
import tty
from typing import Final

from edge.common.own_thread import OwnThread

POLL_S: Final = 0.02  # s between looks at what came
CLOSE_S: Final = 2.0
PIECE: Final = 1 << 16  # bytes read or written at once


class Radio(OwnThread):
    """A pseudo-terminal that is read by a thread of its own. Use as a context manager."""

    def __init__(self) -> None:
        super().__init__("radio", CLOSE_S)
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        for end in (self._near, self._far):
            os.set_blocking(end, False)
        self.device = os.ttyname(self._far)
        self._reads = threading.Event()
        self._reads.set()

    def stick(self) -> None:
        """Read no more; the line is full from now on, with nothing that means anything."""
        self._reads.clear()
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(self._far, bytes(PIECE))

    def read_on(self) -> None:
        """Read again."""
        self._reads.set()

    def close(self) -> None:
        """End it, and the line with it."""
        super().close()
        os.close(self._near)
        os.close(self._far)

    def _run(self) -> None:
        while not self._stop.wait(POLL_S):
            with contextlib.suppress(BlockingIOError):
                if self._reads.is_set():
                    os.read(self._near, PIECE)
