"""Whether a track file is of the picture that its lens file is of.

The hazard is the film that was taken upright and the lens file of the same camera lying: every row outside is dropped
as no measurement, and what is left is solved with the wrong middle. Single rows outside are a tracker's guesses beyond
the edge. Many are another picture, and so are a few where everything else fits the picture turned.
"""

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.station.core.intake import OUTSIDE
from edge.common.arrays import Array
from edge.common.errors import ConfigError

FEWEST_BEYOND: Final = 10  # rows beyond the picture's edge, before anything is made of them
FEWEST_RETURNS: Final = 3  # times that an object was followed out of the picture and back: chance does that once
MOST_SHARE_BEYOND: Final = 0.2  # of rows: no tracker guesses as much as that


def refuse_other_format(pixels: Array, track: NDArray[np.int64], size_px: tuple[int, int], path: Path) -> None:
    """Raises ConfigError if rows are of another picture than the lens: turned, or of more pixels.

    pixels (N, 2), track (N,) of rows in time order; size_px: of the lens.
    """
    size = np.array(size_px, float)
    fresh = np.zeros(len(pixels), bool)
    fresh[np.unique(pixels, axis=0, return_index=True)[1]] = True  # a constant written for "unseen" counts once
    out = fresh & np.any((pixels < -OUTSIDE * size) | (pixels > (1 + OUTSIDE) * size), axis=1)
    count = int(out.sum())
    if count < FEWEST_BEYOND:
        return
    turned = _fits_turned(pixels[fresh], size)
    followed = turned and _returns(out, track) >= FEWEST_RETURNS
    if not followed and count < MOST_SHARE_BEYOND * fresh.sum():
        return
    width, height = pixels[fresh].max(axis=0)
    raise ConfigError(
        f"{count} rows lie outside the {size_px[0]} x {size_px[1]} picture of its lens: they reach to "
        f"({width:.0f}, {height:.0f})" + (", as of a picture that is turned" if turned else ""),
        where=str(path),
        action="give the lens of that picture in site.toml: size_px, intrinsics and distortion belong together",
    )


def _fits_turned(pixels: Array, size: Array) -> bool:
    """Whether all but a few clipped rows lie within the picture lying where it stood."""
    inside = np.all((pixels >= -OUTSIDE * size[::-1]) & (pixels <= (1 + OUTSIDE) * size[::-1]), axis=1)
    return bool(size[0] != size[1] and inside.all())


def _returns(out: NDArray[np.bool_], track: NDArray[np.int64]) -> int:
    """How often a track goes on inside after it was outside."""
    returns = 0
    for number in np.unique(track[out]):
        own = out[track == number]
        returns += int(np.sum(own[:-1] & ~own[1:]))
    return returns
