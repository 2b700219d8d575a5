"""Whether an object can be seen at all in the picture as the camera gave it.

A drone 4 px wide and 25 grey levels off the sky, reduced to 2 px, veiled by noise and coded at few bits, is gone. Its
label is not. A net taught to find what is not there reports empty sky, at every size; taught that nothing is there, it
overlooks the faint. So what cannot be seen is taught as neither.
"""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.train.patches import Box, Floats, Grey

Mask = NDArray[np.bool_]

SEEN_SIGMAS: Final = 4.5  # of the surroundings; noise alone reaches it in 1 of 50 places 2 px wide
LEAST_SIGMA: Final = 0.7  # grey levels: a picture coded in few bits has no grain at all, and yet is no better
SURROUNDINGS_PX: Final = 6  # about the object
LEAST_HALF_PX: Final = 1.5  # of an object: what is smaller is spread over so much by lens and pixels


def visible(stack: Grey, box: Box) -> bool:
    """Whether the object of `box` differs from what is about it, in the newest frame or since an older one."""
    half = np.maximum([box.width_px / 2, box.height_px / 2], LEAST_HALF_PX)
    low = np.maximum(np.floor(np.array([box.x_px, box.y_px]) - half - SURROUNDINGS_PX), 0).astype(int)
    high = np.ceil(np.array([box.x_px, box.y_px]) + half + SURROUNDINGS_PX).astype(int) + 1
    part = stack[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    away_u = np.abs(np.arange(part.shape[1]) + low[0] - box.x_px)
    away_v = np.abs(np.arange(part.shape[0]) + low[1] - box.y_px)[:, None]
    inside = (away_u <= half[0]) & (away_v <= half[1])
    outside = (away_u > half[0] + 1) | (away_v > half[1] + 1)
    views = (part[:, :, 0], part[:, :, 0] - part[:, :, 1], part[:, :, 0] - part[:, :, 2])
    return any(_differs(view, inside, outside) or _differs(_smooth(view), inside, outside) for view in views)


def _smooth(view: Floats) -> Floats:
    """What a large faint object stands out of better than one of a single pixel."""
    return np.asarray(cv2.blur(view, (3, 3), borderType=cv2.BORDER_REFLECT), np.float32)


def _differs(view: Floats, inside: Mask, outside: Mask) -> bool:
    around = view[outside]
    if not (inside.any() and around.size):
        return True
    usual = np.median(around)
    sigma = max(1.4826 * float(np.median(np.abs(around - usual))), LEAST_SIGMA)
    return bool(np.abs(view[inside] - usual).max() > SEEN_SIGMAS * sigma)
