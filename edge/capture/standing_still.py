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
REPEATS_ALLOWED: Final = 2  # in a row, of a recording: 15 frames a second, or 24, written as 30
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
        if not is_same(self._last, image):
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


def is_same(before: Any, image: Any) -> bool:
    """Whether a picture is the one before, None for none. An even one never is: black is black again."""
    if not looks_same(before, image):
        return False
    low, high = np.percentile(image[::SAMPLED_EVERY], EVEN_PERCENTILES)
    return bool(high - low >= EVEN_RANGE) and np.array_equal(before, image)


def looks_same(before: Any, image: Any) -> bool:
    """Whether one row in so many is that of the picture before, None for none: even pictures look the same too."""
    return (
        before is not None
        and before.shape == image.shape
        and np.array_equal(before[::SAMPLED_EVERY], image[::SAMPLED_EVERY])
    )


class StillFor:
    """How long a picture has been the one before: told of network cameras, whose quiet nights may be still."""

    def __init__(self) -> None:
        self._last: Any = None
        self._since_ns = 0

    def seconds(self, image: Any, arrival_ns: int) -> float:
        """After one more picture."""
        if not is_same(self._last, image):
            self._last, self._since_ns = image, arrival_ns
        return (arrival_ns - self._since_ns) / 1e9


class Repeats:
    """Pictures of a recording that are the one before again: where a recorder hung, or a decoder did nothing.

    One or two in a row are what a change of the frame rate makes of a video.
    """

    def __init__(self) -> None:
        self.last: Any = None
        self._run = 0

    def goes_on(self, image: Any) -> bool:
        """Whether a picture is one more of a row that stands still."""
        same = is_same(self.last, image)
        self.last = image
        self._run = self._run + 1 if same else 0
        return self._run > REPEATS_ALLOWED
