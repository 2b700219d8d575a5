"""A receiver on a real pseudo-terminal, for tests of surveying: a hundred times as fast as one in the field."""

import datetime as dt
import threading

import numpy as np

from edge.common.arrays import Array
from tools.doubles.receiver import Place, gga
from tools.doubles.serial_receiver import SerialReceiver

PLACE = Place()
STEP_S = 0.01  # between sentences; each says a second more


class Rover:
    """A receiver on a pty that does what the operator does to it."""

    def __init__(self) -> None:
        self.offset_m: Array = np.zeros(3)
        self.quality = 4
        self.said: dict[str, str] = {}
        self._receiver = SerialReceiver(self._say, period_s=STEP_S, step_s=1.0)
        self._receiver.plug()
        self.device = self._receiver.device

    def reinitialise(self, then_offset_m: tuple[float, float, float]) -> None:
        """Lose the fix for half a second, then be somewhere else."""
        self.quality = 5

        def fixed() -> None:
            self.offset_m = np.array(then_offset_m)
            self.quality = 4

        threading.Timer(0.8, fixed).start()

    def stop(self) -> None:
        """Fall silent."""
        self._receiver.unplug()

    def _say(self, t: dt.datetime) -> bytes:
        return gga(t, PLACE, self.offset_m, quality=self.quality, **self.said)  # type: ignore[arg-type]
