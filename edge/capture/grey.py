"""A grey picture from whatever a decoder gave.

The hazard is the type that looks like a picture: sixteen bits, four channels, one channel with an axis of its own. What
comes out of here is `(H, W)` of eight bits, or an error that says what it was.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image


def grey(image: Image) -> Image:
    """The image `(H, W)`, whatever it was of `(H, W)`, `(H, W, 1)`, BGR or BGRA. Raises ValueError for another."""
    if image.dtype != np.uint8:
        raise ValueError(f"is of {image.dtype}, not of eight bits")
    if image.ndim == 2:
        return image
    channels = image.shape[2]
    if channels == 1:
        return image[:, :, 0]
    if channels not in (3, 4):
        raise ValueError(f"has {channels} channels")
    flat: NDArray[np.uint8] = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY if channels == 3 else cv2.COLOR_BGRA2GRAY)
    return flat
