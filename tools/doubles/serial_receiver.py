"""A receiver at the far end of a pseudo-terminal: the program under test opens a device and gets what one would send.

The hazard is a writer that waits for a reader: a real serial line loses what nobody reads, and so does this one.
"""

import datetime as dt
import os
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

Say = Callable[[dt.datetime], bytes]


class SerialReceiver:
    """Says something each period. Use as a context manager, or plug and unplug it as a USB cable is."""

    def __init__(self, say: Say, *, period_s: float, step_s: float | None = None, link: Path | None = None) -> None:
        """say: the bytes of an epoch. step_s: how much later each says it is, however soon it comes; None: real time.

        link: a name for the device that stays the same, there while it is plugged in.
        """
        self.say = say
        self._period_s, self._step_s, self._link = period_s, step_s, link
        self._t = dt.datetime.now(dt.UTC).replace(microsecond=0)
        self._ends: tuple[int, int] | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread()

    @property
    def device(self) -> str:
        """The serial port to open. Raises RuntimeError if it is not plugged in."""
        if self._ends is None:
            raise RuntimeError("the receiver is not plugged in")
        return os.ttyname(self._ends[1])

    def plug(self) -> None:
        """Appear, and begin to talk."""
        controller, device = self._ends = os.openpty()
        tty.setraw(device)
        os.set_blocking(controller, False)
        if self._link is not None:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(os.ttyname(device))
        self._stopping.clear()
        self._thread = threading.Thread(target=self._talk, args=(controller,), name="serial-receiver")
        self._thread.start()

    def unplug(self) -> None:
        """Vanish; nothing if it is not plugged in."""
        if self._ends is None:
            return
        self._stopping.set()
        self._thread.join()
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        for end in self._ends:
            os.close(end)
        self._ends = None

    def __enter__(self) -> Self:
        self.plug()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unplug()

    def _talk(self, controller: int) -> None:
        while not self._stopping.wait(self._until_next_s()):
            try:
                os.write(controller, self.say(self._epoch()))
            except BlockingIOError:
                continue

    def _until_next_s(self) -> float:
        """Whole periods of UTC in real time, as receivers have it."""
        return self._period_s if self._step_s is not None else self._period_s - time.time() % self._period_s

    def _epoch(self) -> dt.datetime:
        """The instant that is told."""
        if self._step_s is not None:
            self._t += dt.timedelta(seconds=self._step_s)
            return self._t
        return dt.datetime.fromtimestamp(round(time.time() / self._period_s) * self._period_s, dt.UTC)
