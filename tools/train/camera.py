"""What a camera adds to the world: shake, blur, exposure, noise, compression, and frames it did not deliver."""

from typing import Final

import cv2
import numpy as np

from tools.train.patches import Floats, Grey

SHAKEN: Final = 0.15  # shares of the samples: a tripod in the wind,
BLURRED: Final = 0.3  # a lens a little out of focus,
COMPRESSED: Final = 0.4  # a stream of few bits,
STALE: Final = 0.04  # a stream just begun, whose older frames are the newest again
SHAKE_PX: Final = 0.4  # one sigma between frames; more is a moving camera, for which there is the full-frame mode
NOISE: Final = (0.2, 7.0)  # grey levels, one sigma: from full sun to dusk at high gain
JPEG_QUALITY: Final = (35, 92)
DIFFERENCES: Final = 0.6  # of the compressed: those whose later frames are coded as differences, as video is


def noise(random: np.random.Generator) -> float:
    """One sigma of a camera's noise, grey levels."""
    return float(np.exp(random.uniform(np.log(NOISE[0]), np.log(NOISE[1]))))


def expose(image: Floats, sigma: float, random: np.random.Generator) -> Grey:
    """The stack `(H, W, 3)` uint8 that a camera with noise of `sigma` makes of a float one, which is used up."""
    if random.random() < SHAKEN:
        _shake(image, random)
    if random.random() < BLURRED:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), random.uniform(0.3, 1.0)), np.float32)
    image = (image - 128) * random.uniform(0.6, 1.3) + 128 + random.normal(0, 15)
    image = image + random.standard_normal(image.shape, np.float32) * np.float32(sigma)
    stack: Grey = np.clip(image + 0.5, 0, 255).astype(np.uint8)
    if random.random() < COMPRESSED:
        code = code_differences if random.random() < DIFFERENCES else _compress
        code(stack, int(random.integers(*JPEG_QUALITY)))
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
        stack[:, :, k] = _coded(np.ascontiguousarray(stack[:, :, k]), quality)


def code_differences(stack: Grey, quality: int) -> None:
    """The oldest frame as a picture, each later one as what differs from the one before, as far as the bits go.

    A difference too weak for them is left out: noise freezes, and a small object drags a little of its past along.
    """
    oldest = stack.shape[2] - 1
    stack[:, :, oldest] = _coded(np.ascontiguousarray(stack[:, :, oldest]), quality)
    for k in range(oldest - 1, -1, -1):
        before = stack[:, :, k + 1].astype(np.int16)
        halved = np.clip((stack[:, :, k].astype(np.int16) - before) // 2 + 128, 0, 255).astype(np.uint8)
        difference = (_coded(halved, quality).astype(np.int16) - 128) * 2
        stack[:, :, k] = np.clip(before + difference, 0, 255).astype(np.uint8)


def _coded(image: Grey, quality: int) -> Grey:
    coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)
