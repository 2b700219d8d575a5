"""A receiver on a real pseudo-terminal, for tests of surveying: a hundred times as fast as one in the field."""

import datetime as dt
import os
import pty
import threading
import tty

import numpy as np

from edge.common.arrays import Array
from tools.doubles.receiver import Place, gga

PLACE = Place()
STEP_S = 0.01  # between sentences; each says a second more


class Rover:
    """A receiver on a pty that does what the operator does to it."""

    def __init__(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        self.offset_m: Array = np.zeros(3)
        self.quality = 4
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._talk)
        self._thread.start()

    def reinitialise(self, then_offset_m: tuple[float, float, float]) -> None:
        """Lose the fix for half a second, then be somewhere else."""
        self.quality = 5

        def fixed() -> None:
            self.offset_m = np.array(then_offset_m)
            self.quality = 4

        threading.Timer(0.8, fixed).start()

    def stop(self) -> None:
        """Fall silent."""
        self._stopping.set()
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)

    def _talk(self) -> None:
        t = dt.datetime.now(dt.UTC).replace(microsecond=0)
        while not self._stopping.wait(STEP_S):
            t += dt.timedelta(seconds=1)
            try:
                os.write(self._master, gga(t, PLACE, self.offset_m, quality=self.quality))
            except BlockingIOError:
                continue
