"""How finely a position was written down: digits that are not there are not known.

The hazard is the rounded coordinate with an RTK sigma. Four decimals of a degree are eleven metres; whoever copies them
from a map's corner states, with the default, five centimetres. A receiver's own position ends on round digits once in
ten thousand times, so what lies on a round grid in latitude and in longitude was rounded to it.
"""

from typing import Final

import numpy as np

from calib.geodesy import Origin

FINEST: Final = 6  # decimals of a degree: 0.11 m; with one more, what rounding adds is less than RTK's own sigma
GRID_DEG: Final = 1e-9  # 0.1 mm: a position that went through another frame and back is still on its grid
HEIGHTS: Final = 2  # decimals of a metre that a height is looked at
DEGREE_M: Final = 111_320.0  # of a great circle
TOLD: Final = 5  # decimals, up to which a user is told: it makes positions decimetres worse
MORE_DIGITS: Final = "write the position with eight decimals of a degree and the height with two of a metre"
UNIFORM: Final = 1 / np.sqrt(12)  # sigma of what lies anywhere between two grid lines, of their distance


def decimals(position: Origin) -> int | None:
    """To how many decimals of a degree latitude and longitude were written; None if finely enough."""
    for count in range(FINEST + 1):
        if all(abs(angle - round(angle, count)) < GRID_DEG for angle in position[:2]):
            return count
    return None


def as_written(position: Origin, sigma_m: tuple[float, float, float]) -> tuple[float, float, float]:
    """The sigma of a position (east, north, up; m) with what its rounding adds to the one that is stated."""
    count = decimals(position)
    if count is None:
        return sigma_m
    north = DEGREE_M * 10.0**-count
    steps = (north * np.cos(np.radians(position[0])), north, _step_of(position[2]))
    east_m, north_m, up_m = np.hypot(sigma_m, UNIFORM * np.array(steps)).tolist()
    return east_m, north_m, up_m


def rounded(position: Origin) -> str | None:
    """That a position was rounded, in words; None if not so that it matters."""
    count = decimals(position)
    if count is None or count > TOLD:
        return None
    off_m = DEGREE_M * 10.0**-count / 2
    return (
        f"its position is written to {count} decimals of a degree: it may be off by {off_m:.2g} m, which is allowed for"
    )


def _step_of(height_m: float) -> float:
    """m, what a height beside rounded angles was rounded to; 0 if to nothing that matters."""
    return next((10.0**-n for n in range(HEIGHTS) if abs(height_m - round(height_m, n)) < GRID_DEG * DEGREE_M), 0.0)
