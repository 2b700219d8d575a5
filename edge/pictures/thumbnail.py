"""A small picture for the operator's page, and how sharp the large one is.

The hazard is the radio link: a picture is a thousand times a detection. So it is small, comes once a second, and Zenoh
does not carry it at all while nobody subscribes to it.
"""

from typing import Final

import cv2
import numpy as np

from edge.capture.frame import Image

THUMBNAIL_WIDTH_PX: Final = 320
THUMBNAIL_QUALITY: Final = 55  # of 100, JPEG: about 8 kB for a sky, 15 kB for trees
FOCUS_PX: Final = 640  # side of the middle that is judged: lenses are focused there


def thumbnail(image: Image) -> bytes:
    """A JPEG of an image (H, W) or (H, W, 3), at most THUMBNAIL_WIDTH_PX wide."""
    scale = min(1.0, THUMBNAIL_WIDTH_PX / image.shape[1])
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, encoded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, THUMBNAIL_QUALITY])
    return bytes(encoded)


def focus_score(image: Image) -> float:
    """How sharp the middle of an image is: variance of its Laplacian (Pech-Pacheco et al. 2000). Turn for the highest.

    Comparable for one camera and one scene only: a clear sky scores low however sharp it is.
    """
    height, width = image.shape[:2]
    top, left = max(0, (height - FOCUS_PX) // 2), max(0, (width - FOCUS_PX) // 2)
    middle = image[top : top + FOCUS_PX, left : left + FOCUS_PX]
    grey = middle if middle.ndim == 2 else cv2.cvtColor(middle, cv2.COLOR_BGR2GRAY)
    return float(np.var(cv2.Laplacian(grey, cv2.CV_64F)))
