"""Looking closer: the network sees four pixels better than two, even when they hold no more.

Its cells are four pixels wide, and noise is finer than any object; so a thing one or two pixels wide must stand out far
more than one of four before it is believed. Enlarged twice, smoothly, the same thing is believed as readily as if it
were nearer, and noise is not.
"""

from typing import Final

import cv2
import numpy as np

from edge.capture.frame import Image

MAGNIFIED: Final = 2  # times; measured on training clips: a third of the size at a quarter of the contrast


def enlarged(image: Image) -> Image:
    """The image `(H, W)` or `(H, W, channels)` at MAGNIFIED times its size."""
    size = (image.shape[1] * MAGNIFIED, image.shape[0] * MAGNIFIED)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), np.uint8)
