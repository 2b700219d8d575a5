"""Fitting a frame into a model's input without changing its proportions, and back again.

Coordinates here count from the corner of the top-left pixel, as resizing does; `to_frame_px` is the one place where
they turn into pixels counted from that pixel's centre.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from edge.capture.frame import Image
from edge.common.arrays import Array

PAD_VALUE: Final = 114  # the grey that YOLO models are trained to ignore


@dataclass(frozen=True)
class Letterbox:
    """Frame size to input size: one scale, and an offset (x, y) in input pixels."""

    frame_px: tuple[int, int]
    input_px: tuple[int, int]

    @property
    def scale(self) -> float:
        """Input pixels per frame pixel."""
        return min(self.input_px[0] / self.frame_px[0], self.input_px[1] / self.frame_px[1])

    @property
    def inner_px(self) -> tuple[int, int]:
        """Size of the scaled frame within the input."""
        return round(self.frame_px[0] * self.scale), round(self.frame_px[1] * self.scale)

    @property
    def offset_px(self) -> tuple[int, int]:
        """Where the scaled frame begins."""
        return (self.input_px[0] - self.inner_px[0]) // 2, (self.input_px[1] - self.inner_px[1]) // 2

    def apply(self, image: Image) -> Image:
        """The image scaled and padded to `(H, W, ...)` of the input."""
        (width, height), (left, top) = self.inner_px, self.offset_px
        if (width, height) == self.input_px == self.frame_px:
            return image
        out = np.full((self.input_px[1], self.input_px[0], *image.shape[2:]), PAD_VALUE, np.uint8)
        # Linear, as the models were trained with; area averaging costs 2 ms more at 1080p.
        out[top : top + height, left : left + width] = cv2.resize(image, (width, height))
        return out

    def to_frame_px(self, corner_xy: Array) -> Array:
        """Input coordinates `(N, 2)`, counted from the corner, as frame pixels counted from the pixel centre."""
        stretch = np.array(self.inner_px) / np.array(self.frame_px)  # rounding makes it differ a little from `scale`
        frame_xy: Array = (corner_xy - self.offset_px) / stretch - 0.5
        return frame_xy

    def to_frame_size(self, size_xy: Array) -> Array:
        """Input sizes `(N, 2)` in frame pixels."""
        frame_size: Array = size_xy * (np.array(self.frame_px) / np.array(self.inner_px))
        return frame_size
