"""Small pieces of footage made for a test: a dark dot on a bright, noisy sky."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
SKY, DOT, NOISE = 210.0, 30.0, 1.5  # grey levels


def sky(
    size_px: tuple[int, int], dots: list[tuple[float, float]], rng: np.random.Generator, width: float = 6.0
) -> Image:
    """A grey image with dark discs of a width in pixels at sub-pixel places."""
    x, y = np.meshgrid(np.arange(size_px[0]), np.arange(size_px[1]))
    image = np.full((size_px[1], size_px[0]), SKY)
    for u, v in dots:
        cover = np.clip(width / 2 + 0.5 - np.hypot(x - u, y - v), 0, 1)
        image += (DOT - SKY) * cover
    return np.clip(image + rng.normal(0, NOISE, image.shape), 0, 255).astype(np.uint8)


def write_video(path: Path, images: list[Image], fps: float = 30.0) -> Path:
    """An mp4 of grey images."""
    size = (images[0].shape[1], images[0].shape[0])
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
    assert writer.isOpened()
    for image in images:
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def flight(count: int, fps: float = 30.0) -> list[tuple[float, float]]:
    """Where the dot is in each frame: 60 px/s to the right, a little downwards."""
    return [(40.0 + 60.0 * k / fps, 60.0 + 20.0 * k / fps) for k in range(count)]
