"""What a camera adds to the world: shake, blur, exposure, noise, compression, and frames it did not deliver."""

from typing import Final

import cv2
import numpy as np

from tools.train.patches import Floats, Grey

SHAKEN: Final = 0.15  # shares of the samples: a tripod in the wind,
BLURRED: Final = 0.3  # a lens a little out of focus,
COMPRESSED: Final = 0.25  # a stream of few bits,
STALE: Final = 0.04  # a stream just begun, whose older frames are the newest again
SHAKE_PX: Final = 0.4  # one sigma between frames; more is a moving camera, for which there is the full-frame mode
NOISE: Final = (0.2, 7.0)  # grey levels, one sigma: from full sun to dusk at high gain
JPEG_QUALITY: Final = (35, 92)


def expose(image: Floats, random: np.random.Generator) -> Grey:
    """The stack `(H, W, 3)` uint8 that a camera makes of a float one, which is used up."""
    if random.random() < SHAKEN:
        _shake(image, random)
    if random.random() < BLURRED:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), random.uniform(0.3, 1.0)), np.float32)
    image = (image - 128) * random.uniform(0.6, 1.3) + 128 + random.normal(0, 15)
    sigma = float(np.exp(random.uniform(np.log(NOISE[0]), np.log(NOISE[1]))))
    image = image + random.standard_normal(image.shape, np.float32) * np.float32(sigma)
    stack: Grey = np.clip(image + 0.5, 0, 255).astype(np.uint8)
    if random.random() < COMPRESSED:
        _compress(stack, int(random.integers(*JPEG_QUALITY)))
    if random.random() < STALE:
        stack[:, :, 1:] = stack[:, :, :1]
    return stack


def _shake(image: Floats, random: np.random.Generator) -> None:
    size = image.shape[1::-1]
    for k in (1, 2):
        move = np.eye(2, 3)
        move[:, 2] = random.normal(0, SHAKE_PX, 2)
        image[:, :, k] = cv2.warpAffine(image[:, :, k], move, size, borderMode=cv2.BORDER_REFLECT)


def _compress(stack: Grey, quality: int) -> None:
    for k in range(stack.shape[2]):
        coded = cv2.imencode(".jpg", stack[:, :, k], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        stack[:, :, k] = np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)
