"""The height of the geoid above the ellipsoid, by EGM96: a second witness for what a receiver says of it.

The hazard is the plausible zero. A receiver that sends a height above sea level and a separation of 0.0, or one of the
wrong sign, puts a site tens of metres underground at a sigma of two centimetres, and nothing else can see it.
Bilinear between the nodes of a quarter of a degree (0.1 m rms, 1.3 m in one of a thousand places); made by
tools/make_geoid.py, which says where it comes from.
"""

import lzma
import math
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from edge.common.arrays import Array

FILE: Final = Path(__file__).parent / "egm96_15.xz"
ROWS, COLUMNS = 721, 1440  # of nodes, from 90 S and 180 W
NODES_PER_DEGREE: Final = 4
UNIT_M: Final = 0.05  # m, of the numbers in the file

# m. A receiver's own table is coarser than this one, and its heights are right as long as it takes off what it added.
MOST_APART_M: Final = 10.0
# m. Exactly zero is no table's value but nobody's: where the geoid is farther away, it is not known.
LEAST_NOT_ZERO_M: Final = 2.0
SITE_ZERO_M: Final = 0.5  # m. The same, where the site's own geoid is known
# m. As good as the geoid's height with the other sign, and farther than this from it with its own.
MIRRORED_M, MIRRORED_APART_M = 1.5, 3.0


def undulation_m(lat_deg: float, lon_deg: float) -> float:
    """Geoid above ellipsoid, metres; latitude and longitude in degrees. Source: EGM96 (Lemoine et al., 1998)."""
    heights = _heights_m()
    row = min(max(lat_deg + 90, 0.0), 180.0) * NODES_PER_DEGREE
    column = (lon_deg + 180) % 360 * NODES_PER_DEGREE
    south, west = min(math.floor(row), ROWS - 2), math.floor(column) % COLUMNS
    up, right, east = row - south, column - math.floor(column), (west + 1) % COLUMNS
    lower = (1 - right) * heights[south, west] + right * heights[south, east]
    upper = (1 - right) * heights[south + 1, west] + right * heights[south + 1, east]
    return float((1 - up) * lower + up * upper)


def contradiction(separation_m: float, known_m: float, what: str, *, zero_from_m: float = LEAST_NOT_ZERO_M) -> str:
    """Why a receiver's geoid separation cannot be right where `what` says known_m; empty if it can."""
    apart_m = abs(separation_m - known_m)
    if separation_m == 0 and apart_m > zero_from_m:
        return f"{separation_m:g} m, {what} {known_m:.1f} m"
    if abs(separation_m + known_m) < MIRRORED_M and apart_m > MIRRORED_APART_M:
        return f"{separation_m:g} m has the wrong sign, {what} {known_m:.1f} m"
    return f"{separation_m:g} m, {what} {known_m:.1f} m" if apart_m > MOST_APART_M else ""


@cache
def _heights_m() -> Array:
    along = np.frombuffer(lzma.decompress(FILE.read_bytes()), "<i2").reshape(ROWS, COLUMNS)
    heights: Array = np.cumsum(along, axis=1, dtype=np.float64) * UNIT_M
    return heights
