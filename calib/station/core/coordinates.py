"""How finely a position was written down: digits that are not there are not known.

The hazard is the rounded coordinate that comes without a sigma. Four decimals of a degree are eleven metres; whoever
copies them from a map's corner states, with the default, five centimetres. A receiver's own position ends on round
digits once in ten thousand times, so a site whose cameras all stand on a round grid in latitude and in longitude was
rounded to it.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.geodesy import Origin
from calib.station.config import UNSTATED_SIGMA_M

FINEST: Final = 6  # decimals of a degree: 0.11 m; with one more, what rounding adds is less than RTK's own sigma
FEWEST: Final = 2  # positions on one round grid, that are no accident
GRID_DEG: Final = 1e-9  # 0.1 mm: a position that went through another frame and back is still on its grid
HEIGHTS: Final = 2  # decimals of a metre that a height is looked at
DEGREE_M: Final = 111_320.0  # of a great circle
TOLD: Final = 5  # decimals, up to which a user is told: it makes positions decimetres worse
MORE_DIGITS: Final = "write the position with eight decimals of a degree and the height with two of a metre"
UNIFORM: Final = 1 / np.sqrt(12)  # sigma of what lies anywhere between two grid lines, of their distance


@dataclass(frozen=True)
class Written:
    """How the positions of a site were written. decimals: of a degree, the most that any needs; None: finely enough."""

    decimals: int | None

    @classmethod
    def of(cls, positions: Iterable[tuple[Origin, tuple[float, float, float]]]) -> "Written":
        """From all of them that come without a sigma of their own: latitude, longitude, height; sigma.

        One alone says nothing: a camera may stand at the origin, and that is a round place.
        """
        found = [_decimals(position) for position, sigma_m in positions if sigma_m == UNSTATED_SIGMA_M]
        fine = len(found) < FEWEST or any(one is None for one in found)
        return cls(None if fine else max(one for one in found if one is not None))

    def sigma_m(self, position: Origin, stated_m: tuple[float, float, float]) -> tuple[float, float, float]:
        """The sigma of a position (east, north, up; m), with what its rounding adds where nobody stated one."""
        if self.decimals is None or stated_m != UNSTATED_SIGMA_M:
            return stated_m
        north = DEGREE_M * 10.0**-self.decimals
        steps = (north * np.cos(np.radians(position[0])), north, _step_of(position[2]))
        east_m, north_m, up_m = np.hypot(stated_m, UNIFORM * np.array(steps)).tolist()
        return east_m, north_m, up_m

    @property
    def coarse(self) -> str | None:
        """That positions were rounded, in words; None if not so that it matters."""
        if self.decimals is None or self.decimals > TOLD:
            return None
        off_m = DEGREE_M * 10.0**-self.decimals / 2
        return (
            f"the positions are written to {self.decimals} decimals of a degree: each may be off by {off_m:.2g} m, "
            "which is allowed for"
        )


def _decimals(position: Origin) -> int | None:
    """To how many decimals of a degree latitude and longitude were written; None if finely enough."""
    for count in range(FINEST + 1):
        if all(abs(angle - round(angle, count)) < GRID_DEG for angle in position[:2]):
            return count
    return None


def _step_of(height_m: float) -> float:
    """m, what a height beside rounded angles was rounded to; 0 if to nothing that matters."""
    return next((10.0**-n for n in range(HEIGHTS) if abs(height_m - round(height_m, n)) < GRID_DEG * DEGREE_M), 0.0)
