"""Two cameras that say the same: one stream registered under two names, or a folder that was copied.

The hazard is a witness who is heard twice. Such a pair has no parallax at all; the adjustment puts both at one place,
and then blames a surveyed position, or a lens, of somebody who is fine. No two cameras measure the same pixels in the
same order, to the last digit, while something moves: where they do, nothing is solved before one of them is gone.
"""

from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.errors import CalibrationError
from calib.observations import Observations
from calib.solving.unseen import quantum_px
from edge.common.arrays import Array

TOGETHER: Final = 4  # rows in a row that are alike: two that hover may share a pixel, but not a path
FEWEST_ALIKE: Final = 20  # such runs
LEAST_WAY: Final = 6.0  # of what pixels are rounded to, that something moves in such a run
SHARE_ALIKE: Final = 0.05  # of the shorter camera's; rows lost on the way break most of them


def refuse_copies(seen: dict[str, Observations], where: str) -> None:
    """Raises CalibrationError if two cameras have the same rows. seen: by camera."""
    paths = {name: _paths(own.pixels) for name, own in seen.items()}
    for one, two in combinations(sorted(seen), 2):
        least = min(len(paths[one]), len(paths[two]))
        if least and len(np.intersect1d(paths[one], paths[two])) > max(FEWEST_ALIKE, SHARE_ALIKE * least):
            raise CalibrationError(
                f"the rows of {two} are those of {one}: one of them is a copy, or one stream has two names",
                where=where,
                action="give each camera its own rows, or leave one out (--cameras)",
            )


def _paths(pixels: Array) -> NDArray[np.uint64]:
    """A number for each TOGETHER pixels that follow one another and move: where nothing does, all are alike."""
    bits = np.ascontiguousarray(pixels, np.float64).view(np.uint64).reshape(-1, 2)
    if len(bits) < TOGETHER:
        return np.zeros(0, np.uint64)
    mixed = np.zeros(len(bits) - TOGETHER + 1, np.uint64)
    for k in range(TOGETHER):
        for column in (0, 1):
            mixed = (mixed ^ bits[k : len(bits) - TOGETHER + 1 + k, column]) * np.uint64(0x9E3779B97F4A7C15)
            mixed ^= mixed >> np.uint64(29)
    path = np.lib.stride_tricks.sliding_window_view(pixels, TOGETHER, axis=0)
    moving = np.ptp(path, axis=2).max(axis=1) > LEAST_WAY * quantum_px(pixels)
    return np.unique(mixed[moving])
