"""What of a picture becomes a sample: a window, flipped, perhaps slightly zoomed.

The hazard is softness. A drone far away is one or two dark pixels, and every shift by parts of a pixel spreads them
over four. So half of the windows are taken pixel for pixel.
"""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from tools.train.patches import Box, Floats, Grey

CROP_PX: Final = 80  # larger than the 64 px crops of the box, so that most cells see no border
AS_IT_IS: Final = 0.5  # of the windows: those neither zoomed nor shifted by parts of a pixel


def crop(
    stack: Grey, boxes: Sequence[Box], random: np.random.Generator, about: Floats | None = None
) -> tuple[Floats, list[Box]]:
    """A flipped, perhaps slightly zoomed CROP_PX window that holds the first box, or else the place `about`, or any."""
    as_it_is = random.random() < AS_IT_IS
    zoom = 1.0 if as_it_is else random.uniform(0.8, 1.2)
    flip = -1.0 if random.random() < 0.5 else 1.0
    half = (CROP_PX - 1) / 2
    held = np.array([boxes[0].x_px, boxes[0].y_px]) if boxes else about
    if held is not None:
        reach = CROP_PX / 2 - 3
        wanted = held + random.uniform(-reach, reach, 2) / zoom
    else:
        wanted = random.uniform(0, stack.shape[1::-1])
    # Kept inside the patch where it can be: beyond its border everything is made up.
    centre = (np.array(stack.shape[1::-1]) - 1) / 2
    free = np.maximum(centre - half / zoom, 0)
    u, v = np.clip(wanted, centre - free, centre + free)
    if as_it_is:
        u, v = np.floor(u) + 0.5, np.floor(v) + 0.5
    to_crop = np.array([[flip * zoom, 0, half - flip * zoom * u], [0, zoom, half - zoom * v]])
    image = cv2.warpAffine(stack, to_crop, (CROP_PX, CROP_PX), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    placed = []
    for box in boxes:
        x, y = to_crop @ [box.x_px, box.y_px, 1]
        if 0 <= x < CROP_PX and 0 <= y < CROP_PX:
            size = (box.width_px * zoom, box.height_px * zoom)
            placed.append(Box(float(x), float(y), *size, box.label, box.exact, box.telling))
    return image.astype(np.float32), placed
