"""A model's answer to a trial picture, held against what every detection obeys. Pure.

The hazard is the plausible reading of the wrong family: shapes alone do not tell corners from centres, nor shares from
pixels. A run does: boxes with negative sizes, larger than the picture, outside of it, or all sure contradict a reading.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.detector.formats import Candidates, SizePx

GREY_LEVEL: Final = 114  # what models are padded with
DOT_LEVEL: Final = 20  # grey level of the dot
DOT_SHARE: Final = 0.03  # of the picture's shorter side
JUDGED_ROWS: Final = 100  # the surest; what lies below is noise in any reading
LEAST_SCORE: Final = 1e-6  # below it rows are padding
MOST_CONTRARY_WEAK: Final = 0.5  # of those without a score, which nobody trained to be good
MOST_CONTRARY: Final = 0.02  # share of rows that may be odd: a half-trained model's are
PICTURES_WIDE: Final = 2.0  # times the picture
FURTHEST_OUT: Final = 0.25  # of the picture's side, that centres may lie outside
SURE_SCORE: Final = 0.5  # score
ONE_PLACE: Final = 0.1  # of the picture's side around the surest row: a grid has many rows for one object
MANY_ROWS: Final = 50  # of which most being sure says that scores are read wrongly: one dot is shown


def trial_picture(size_px: SizePx, channels: int) -> NDArray[np.uint8]:
    """A dark dot on grey at two fifths of width and height, `(H, W)` or `(H, W, 3)`."""
    width, height = size_px
    down, across = np.mgrid[0:height, 0:width]
    image = np.full((height, width), GREY_LEVEL, np.uint8)
    image[np.hypot(across - 0.4 * width, down - 0.4 * height) <= DOT_SHARE * min(size_px)] = DOT_LEVEL
    return image if channels == 1 else np.repeat(image[:, :, None], channels, axis=2)


def contradiction(found: Candidates, input_px: SizePx, *, padded: bool = False) -> str:
    """Why boxes of the trial picture, decoded at a least score of 0, cannot be right; empty if they can.

    padded: whether rows without a score may be no boxes at all; else they are judged too where no other is there.
    """
    judged, contrary = _judged(found, padded)
    if not len(judged):
        return ""
    centre, size, score = found.centre[judged], found.size[judged], found.score[judged]
    limit = np.array(input_px, dtype=np.float64)
    odd = {
        "sizes below 0": (size < 0).any(axis=1),
        "boxes larger than the picture": (size > PICTURES_WIDE * limit).any(axis=1),
        "boxes outside the picture": ((centre < -FURTHEST_OUT * limit) | (centre > (1 + FURTHEST_OUT) * limit)).any(
            axis=1
        ),
        "scores above 1": score > 1 + 1e-3,
    }
    for what, rows in odd.items():
        if rows.mean() > contrary:
            return what
    if np.all(np.abs(centre) <= PICTURES_WIDE) and np.all(np.abs(size) <= PICTURES_WIDE):
        return "all boxes within a pixel or two"
    elsewhere = np.any(np.abs(centre - centre[0]) > ONE_PLACE * limit, axis=1)  # the surest is the first
    if len(score) >= MANY_ROWS and (elsewhere & (score > SURE_SCORE)).mean() > SURE_SCORE:
        return "a picture full of objects where one dot is shown"
    return ""


def _judged(found: Candidates, padded: bool) -> tuple[NDArray[np.intp], float]:
    """Which rows are judged, surest first, and the share of them that may be odd."""
    finite = np.isfinite(found.centre).all(axis=1) & np.isfinite(found.size).all(axis=1) & np.isfinite(found.score)
    order = np.argsort(np.where(finite, -found.score, np.inf), kind="stable")
    order = order[finite[order]]
    sure = order[found.score[order] >= LEAST_SCORE]
    if len(sure) or padded:
        return sure[:JUDGED_ROWS], MOST_CONTRARY
    return order[np.any(found.size[order] != 0, axis=1)][:JUDGED_ROWS], MOST_CONTRARY_WEAK
