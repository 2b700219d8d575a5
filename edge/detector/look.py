"""The network on a whole picture, as it is and, if that is a small one, enlarged: each look sees what the other cannot.

As it is, a thing of one or two pixels is hardly seen. Enlarged it is; but so are single pixels of grain, and an object
larger than the network knows falls into parts. So only pictures are enlarged that were reduced before they came here,
as a camera's second stream is: their grain has been averaged away, and in them one pixel is a real thing. And the
enlarged look only counts for what is small, is no part of something large seen as it is, and is surer.
"""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image
from edge.common.arrays import Array
from edge.detector.detections import Detections, together
from edge.detector.magnify import enlarged, reduced
from edge.detector.nms import suppress
from edge.detector.skyfix import StackNet

SAME_OBJECT_IOU: Final = 0.2  # one object seen twice overlaps itself by far more, two objects by less
LEAST_SIZE_PX: Final = 4.0  # taken for the overlap of what is smaller: a box of one pixel misses its like by one
SMALL_PX: Final = 22.0  # longer side: enlarged, what is larger is larger than what the network was trained on
ENLARGED_SCORE: Final = 0.4  # on skies of noise alone: as many enlarged at this as there are at 0.25 as it is
REDUCED_PX: Final = 640 * 480  # of all its pixels: no camera for daylight has fewer, so such a picture was reduced
LEAST_SIDE_PX: Final = 64  # of what the network is shown: it has to find as many peaks as it tells


def look(net: StackNet, images: list[Image], score_min: float) -> Detections:
    """What is in the newest of grey images `(H, W)`, newest first, in its pixels, the surest first."""
    found = net.run(padded_stack(images, net.multiple_px), score_min)[0]
    if is_reduced(images[0]):
        larger = padded_stack([enlarged(image) for image in images], net.multiple_px)
        closer = reduced(net.run(larger, max(score_min, ENLARGED_SCORE))[0])
        found = together([found, _small_and_whole(closer, found)], found.classes.shape[1])
    found = _within(found, images[0].shape)
    size_px = np.maximum(found.size_px, LEAST_SIZE_PX)
    return found.where(suppress(found.centre_px, size_px, found.score, SAME_OBJECT_IOU))


def is_reduced(image: Image) -> bool:
    """Whether a grey image `(H, W)` is smaller than cameras take them."""
    return image.size < REDUCED_PX


def _small_and_whole(closer: Detections, found: Detections) -> Detections:
    """Of what was seen enlarged, the small things that lie in nothing large that was seen as it is."""
    large = found.where(_longer_side(found) > SMALL_PX)
    off = np.abs(closer.centre_px[:, None] - large.centre_px)
    part = np.any(np.all(off <= large.size_px / 2 + 1, axis=2), axis=1)
    return closer.where((_longer_side(closer) <= SMALL_PX) & ~part)


def _longer_side(found: Detections) -> Array:
    return np.asarray(found.size_px.max(axis=1, initial=0.0))


def _within(found: Detections, shape: tuple[int, ...]) -> Detections:
    """Those whose centre lies in the picture and not in what was added to fill it up."""
    return found.where(np.all(found.centre_px <= (shape[1] - 0.5, shape[0] - 0.5), axis=1))


def padded_stack(images: list[Image], multiple_px: int) -> NDArray[np.uint8]:
    """Grey images as one `(1, H, W, len(images))`, sides filled up to what the network takes."""
    stack: NDArray[np.uint8] = cv2.merge([_padded(image, multiple_px) for image in images])[None]
    return stack


def _padded(image: Image, multiple_px: int) -> Image:
    down, right = (max(-side % multiple_px, LEAST_SIDE_PX - side) for side in image.shape[:2])
    if not (down or right):
        return image
    padded: Image = cv2.copyMakeBorder(image, 0, down, 0, right, cv2.BORDER_REPLICATE)
    return padded
