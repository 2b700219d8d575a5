"""The network on a whole picture, as it is and, if not too dear, enlarged: each look sees what the other cannot.

Enlarged, an object larger than the network knows is seen in parts; as it is, one of two pixels is hardly seen. Both
looks are merged, and of two findings of one object the surer is kept.
"""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image
from edge.detector.detections import Detections, together
from edge.detector.magnify import MAGNIFIED, enlarged, reduced
from edge.detector.nms import suppress
from edge.detector.skyfix import StackNet

SAME_OBJECT_IOU: Final = 0.2  # one object seen twice overlaps itself by far more, two objects by less
LARGEST_ENLARGED_PX: Final = 1920 * 1088  # in all: a small picture may cost what a full-HD one does, and no more


def look(net: StackNet, images: list[Image], score_min: float) -> Detections:
    """What is in the newest of grey images `(H, W)`, newest first, in its pixels, the surest first."""
    found = net.run(padded_stack(images, net.multiple_px), score_min)[0]
    if images[0].size * MAGNIFIED**2 <= LARGEST_ENLARGED_PX:
        closer = net.run(padded_stack([enlarged(image) for image in images], net.multiple_px), score_min)[0]
        found = together([found, reduced(closer)], found.classes.shape[1])
    return found.where(suppress(found.centre_px, found.size_px, found.score, SAME_OBJECT_IOU))


def padded_stack(images: list[Image], multiple_px: int) -> NDArray[np.uint8]:
    """Grey images as one `(1, H, W, len(images))`, sides filled up to what the network takes."""
    stack: NDArray[np.uint8] = cv2.merge([_padded(image, multiple_px) for image in images])[None]
    return stack


def _padded(image: Image, multiple_px: int) -> Image:
    down, right = -image.shape[0] % multiple_px, -image.shape[1] % multiple_px
    if not (down or right):
        return image
    padded: Image = cv2.copyMakeBorder(image, 0, down, 0, right, cv2.BORDER_REPLICATE)
    return padded
