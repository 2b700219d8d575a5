"""Square pieces of a frame at a fixed size, chosen around regions of interest, and their coordinates.

A region too large for the piece is cut out larger and reduced by a whole factor, so the network always sees its object
at the sizes it was trained on.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image
from edge.common.arrays import Array
from edge.detector.detections import Detections

SIDE_PX: Final = 64  # measured: 96 finds no more at twice the cost
LARGEST_EXTENT: Final = 30.0  # px in the piece: leaves as much surroundings as object
REDUCTIONS: Final = (1, 2, 4, 8)
COVERED_PX: Final = 14.0  # px from the middle of a piece: what is nearer needs no piece of its own
MARGIN_PX: Final = 5.0  # px along a piece's edge where an object may be cut off and its centre wrong


@dataclass(frozen=True)
class Crop:
    """A square of the frame: its top-left pixel, and by how much it is reduced."""

    left: int
    top: int
    reduction: int

    @property
    def side_px(self) -> int:
        """Length of its side in the frame."""
        return SIDE_PX * self.reduction


def choose(regions: Array, frame_px: tuple[int, int], limit: int) -> list[Crop]:
    """Crops that cover regions `(N, 3)` of u, v, extent, the most important first, at most `limit` of them."""
    return add([], regions, frame_px, limit)[0]


def add(crops: list[Crop], regions: Array, frame_px: tuple[int, int], limit: int) -> tuple[list[Crop], int]:
    """Crops with further ones that cover regions, at most `limit` in all; and how many regions are covered."""
    crops = list(crops)
    covered = [_covered(crop) for crop in crops]
    for index, (u, v, extent) in enumerate(regions.tolist()):
        reduction = next((r for r in REDUCTIONS if extent <= LARGEST_EXTENT * r), REDUCTIONS[-1])
        if any(
            r == reduction and abs(u - at_u) <= reach and abs(v - at_v) <= reach for at_u, at_v, reach, r in covered
        ):
            continue
        if len(crops) >= limit:
            return crops, index
        crops.append(_around(u, v, reduction, frame_px))
        covered.append(_covered(crops[-1]))
    return crops, len(regions)


def _covered(crop: Crop) -> tuple[float, float, float, int]:
    """Middle of a crop, how far around it what is there is seen, and its reduction."""
    half = crop.side_px / 2 - 0.5
    return crop.left + half, crop.top + half, COVERED_PX * crop.reduction, crop.reduction


def _around(u: float, v: float, reduction: int, frame_px: tuple[int, int]) -> Crop:
    """Shifted into the frame where it would reach out of it, so that no border has to be invented."""
    side = SIDE_PX * reduction
    left, top = (
        min(max(round(at + 0.5 - side / 2), 0), max(0, length - side))
        for at, length in zip((u, v), frame_px, strict=True)
    )
    return Crop(left, top, reduction)


def cut(images: list[Image], crops: list[Crop]) -> NDArray[np.uint8]:
    """The crops of several grey images as `(B, SIDE, SIDE, len(images))`, last axis in the order of `images`."""
    out = np.empty((len(crops), SIDE_PX, SIDE_PX, len(images)), np.uint8)
    for index, crop in enumerate(crops):
        for channel, image in enumerate(images):
            out[index, :, :, channel] = _piece(image, crop)
    return out


def _piece(image: Image, crop: Crop) -> Image:
    side = crop.side_px
    piece = image[crop.top : crop.top + side, crop.left : crop.left + side]
    down, right = side - piece.shape[0], side - piece.shape[1]
    if down or right:
        piece = cv2.copyMakeBorder(piece, 0, down, 0, right, cv2.BORDER_REPLICATE)
    if crop.reduction == 1:
        return piece
    reduced: Image = cv2.resize(piece, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA)
    return reduced


def in_frame(found: Detections, crops: list[Crop], index: NDArray[np.intp], frame_px: tuple[int, int]) -> Detections:
    """Detections in crops, those of number `index` `(N,)` each, as detections in the frame, all at once.

    Those too near an edge of the crop that is no edge of the frame are left out: another crop shows them whole.
    """
    corner = np.array([(crop.left, crop.top) for crop in crops])
    side = np.array([crop.side_px for crop in crops])
    low = np.where(corner > 0, MARGIN_PX, -1.0)[index]
    high = np.where(corner + side[:, None] < frame_px, SIDE_PX - 1 - MARGIN_PX, SIDE_PX)[index]
    whole = np.all((found.centre_px >= low) & (found.centre_px <= high), axis=1)
    found, index = found.where(whole), index[whole]
    reduction = (side // SIDE_PX)[index]
    return Detections(
        (found.centre_px + 0.5) * reduction[:, None] - 0.5 + corner[index],
        found.size_px * reduction[:, None],
        found.score,
        found.sigma_px * reduction,
        found.classes,
    )
