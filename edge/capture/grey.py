"""A grey picture from whatever a decoder gave.

The hazard is the type that looks like a picture: sixteen bits, four channels, one channel with an axis of its own. What
comes out of here is `(H, W)` of eight bits, or an error that says what it was.
"""

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image

STRETCHED_PERCENTILES: Final = (0.5, 99.5)  # of a picture: a dead pixel or a flame does not set the contrast
ROOM: Final = 1.0  # times that range left below and above: what flies is warmer or colder than the scene
LEAST_RANGE: Final = 16.0  # steps: an even sky is not stretched until its noise fills the picture


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


def as_wanted(image: Image, *, colour: bool) -> Image:
    """An eight-bit picture in grey, or in BGR for a model that wants colours of a grey camera too."""
    if not colour:
        return grey(image)
    bgr: Image = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    return bgr


class Contrast:
    """Sixteen bits to eight by contrast: one stretch for all pictures, for one that moved would look like motion.

    A thermal camera's scene fills a few hundred of its 16384 steps; the upper eight bits show nothing of it. The
    stretch is taken from the first picture and kept while pictures fit it.
    """

    def __init__(self) -> None:
        self._range: tuple[float, float] | None = None

    def apply(self, image: NDArray[Any]) -> Image:
        """The image with eight bits a channel; one that has them already is left as it is."""
        if image.dtype == np.uint8:
            return image
        sample = image[::4, ::4].astype(np.float32)
        low, high = (float(value) for value in np.percentile(sample, STRETCHED_PERCENTILES))
        if self._range is None or not self._range[0] <= float(np.median(sample)) <= self._range[1]:
            room = max(high - low, LEAST_RANGE) * ROOM
            self._range = (low - room, high + room)
        begin, end = self._range
        scale = 255.0 / (end - begin)
        stretched: Image = np.clip((image.astype(np.float32) - begin) * scale, 0, 255).astype(np.uint8)
        return stretched
