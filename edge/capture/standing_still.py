"""Pictures that are the one before again, of a camera whose sensor's noise never is the same twice.

The hazard is a driver that hands out its last picture with a new stamp: it shows where things were and not where they
are. A thermal camera does it for a second while it closes its shutter to calibrate; one that does so longer is dead.
"""

import logging
from typing import Any, Final

import numpy as np

from edge.common.errors import SourceError

log = logging.getLogger(__name__)

SAMPLED_EVERY: Final = 16  # rows, looked at first
EVEN_PERCENTILES: Final = (5, 95)
EVEN_RANGE: Final = 4  # steps between them, without which a picture is even, and no two of it can be told apart
CALIBRATION_S: Final = 4.0  # s: the longest a shutter is closed; standing still for longer is a dead camera


class StandingStill:
    """Tells pictures that are the one before from new ones. A sensor's noise never is the same twice."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._last: Any = None
        self._since_ns: int | None = None
        self.repeated = 0

    def repeats(self, image: Any, arrival_ns: int) -> bool:
        """Whether a picture is the one before. Raises SourceError once that lasted longer than any calibration."""
        if not self._same(image):
            if self._since_ns is not None and (still_s := (arrival_ns - self._since_ns) / 1e9) > 0.2:
                log.info("%s: the picture stood still for %.1f s, as at a shutter's calibration", self._path, still_s)
            self._last, self._since_ns = image, None
            return False
        self.repeated += 1
        self._since_ns = self._since_ns or arrival_ns
        if arrival_ns - self._since_ns > CALIBRATION_S * 1e9:
            action = "it is opened again by itself; else take its plug out and in, another cable, another port"
            raise SourceError(
                f"its picture has been frozen for more than {CALIBRATION_S:g} s", where=self._path, action=action
            )
        return True

    def _same(self, image: Any) -> bool:
        if self._last is None or self._last.shape != image.shape:
            return False
        rows = image[::SAMPLED_EVERY]
        if not np.array_equal(self._last[::SAMPLED_EVERY], rows):
            return False
        low, high = np.percentile(rows, EVEN_PERCENTILES)  # black is black again
        return bool(high - low >= EVEN_RANGE) and np.array_equal(self._last, image)
