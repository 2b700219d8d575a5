"""What a distant flying thing looks like: a few dark polygons, placed to a hundredth of a pixel.

The hazard is a picture whose centre is not where the label says: a detector trained or measured on it would learn the
error. So every shape is drawn once, large; the centre of its darkness is measured on that very drawing, and all smaller
pictures are made from it by averaging, at all the positions it had while the shutter was open.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

MASTER_PX: Final = 512  # width of the drawing a shape is made from
LEVELS: Final = 6  # halvings of it: down to 8 px, what a 2 px object needs
FINE: Final = 4  # drawn pixels per image pixel, averaged afterwards
LENS_BLUR_PX: Final = 0.55  # one sigma of an ordinary lens in focus
STEP_PX: Final = 0.5  # motion a sub-exposure may make: shorter steps cannot be told from a smear
MOST_STEPS: Final = 24
FLAP_PHASES: Final = 16  # wing positions kept; finer ones differ by less than a pixel on any bird drawn here

Matte = NDArray[np.float32]


@dataclass(frozen=True)
class Shape:
    """A drawn outline. corners: (K, 2) about the centre of darkness, in units of the object's width, y down.

    levels: mattes of 0..1, each half as large as the one before; centre: (2,) of the first, in its pixels.
    """

    corners: Array
    levels: tuple[Matte, ...]
    centre: Array


@lru_cache(maxsize=64)
def shape(kind: str, aspect: float, phase: int = 0) -> Shape:
    """The outline of a kind of object; aspect: height over width; phase: of the wings, 0 to FLAP_PHASES - 1."""
    polygons, opacity = _OUTLINES[kind](aspect, 2 * np.pi * phase / FLAP_PHASES)
    corners = np.vstack(polygons)
    # A square with an eighth of margin, so that all levels are whole and clear of the border.
    size = int(np.ceil(1.25 * MASTER_PX / 2**LEVELS)) * 2**LEVELS
    middle = size / 2.0
    canvas = np.zeros((size, size), np.uint8)
    # Darkest last: fillPoly overwrites, and a see-through rotor must not lighten the body below it.
    for share, polygon in sorted(zip(opacity, polygons, strict=True), key=lambda pair: pair[0]):
        cv2.fillPoly(canvas, [np.round(polygon * MASTER_PX + middle).astype(np.int32)], round(255 * share))
    moments = cv2.moments(canvas)
    centre: Array = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    return Shape(corners - (centre - middle) / MASTER_PX, _halved(canvas), centre)


def _halved(canvas: NDArray[np.uint8]) -> tuple[Matte, ...]:
    levels = [np.asarray(canvas / 255.0, np.float32)]
    for _ in range(LEVELS):
        height, width = levels[-1].shape
        levels.append(np.asarray(levels[-1].reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3)), np.float32))
    return tuple(levels)


Outline = tuple[list[Array], tuple[float, ...]]


def _drone(aspect: float, _phase: float) -> Outline:
    """Body, landing gear, two arms and two blurred rotors, seen from the side."""
    h = aspect
    body = _ellipse(0.0, 0.0, 0.19, 0.32 * h)
    gear = np.array(
        [[-0.16, 0.1 * h], [-0.20, 0.5 * h], [-0.14, 0.5 * h], [0.14, 0.5 * h], [0.2, 0.5 * h], [0.16, 0.1 * h]]
    )
    arms = np.array([[-0.36, -0.16 * h], [0.36, -0.16 * h], [0.36, 0.06 * h], [-0.36, 0.06 * h]])
    rotors = [_ellipse(side * 0.33, -0.4 * h, 0.17, 0.1 * h) for side in (-1, 1)]
    motors = [_ellipse(side * 0.33, -0.22 * h, 0.045, 0.22 * h) for side in (-1, 1)]
    return [body, gear, arms, *motors, *rotors], (1.0, 0.45, 0.95, 0.95, 0.95, 0.5, 0.5)


def _bird(aspect: float, phase: float) -> Outline:
    """Two wings that beat and a body between them."""
    lift = -np.sin(phase) * aspect
    wings = [
        np.array(
            [
                [0.0, -0.08],
                [side * 0.25, 0.55 * lift - 0.05],
                [side * 0.5, lift],
                [side * 0.22, 0.5 * lift + 0.07],
                [0.0, 0.08],
            ]
        )
        for side in (-1, 1)
    ]
    return [_ellipse(0.0, 0.0, 0.07, 0.1), *wings], (1.0, 0.9, 0.9)


def _aeroplane(aspect: float, _phase: float) -> Outline:
    """Fuselage, swept wings and tail, from below and aside."""
    fuselage = _ellipse(0.0, 0.0, 0.5, 0.11 * aspect)
    wing = np.array(
        [
            [0.08, 0.0],
            [-0.22, 0.5 * aspect],
            [-0.3, 0.5 * aspect],
            [-0.12, 0.0],
            [-0.3, -0.4 * aspect],
            [-0.22, -0.4 * aspect],
        ]
    )
    tail = np.array([[-0.38, 0.0], [-0.5, -0.3 * aspect], [-0.46, 0.0]])
    return [fuselage, wing, tail], (1.0, 0.9, 1.0)


def _helicopter(aspect: float, _phase: float) -> Outline:
    """Cabin, tail boom, and a rotor disc that the sky shines through."""
    cabin = _ellipse(0.16, 0.1 * aspect, 0.2, 0.36 * aspect)
    boom = np.array([[0.0, -0.06 * aspect], [-0.46, -0.1 * aspect], [-0.46, 0.02 * aspect], [0.0, 0.14 * aspect]])
    fin = np.array([[-0.42, 0.0], [-0.5, -0.3 * aspect], [-0.46, -0.3 * aspect], [-0.38, 0.0]])
    rotor = _ellipse(0.1, -0.4 * aspect, 0.4, 0.05 * aspect)
    return [cabin, boom, fin, rotor], (1.0, 1.0, 1.0, 0.45)


_OUTLINES: Final = {"drone": _drone, "bird": _bird, "aeroplane": _aeroplane, "helicopter": _helicopter}


def _ellipse(x: float, y: float, half_width: float, half_height: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    return np.column_stack([x + half_width * np.cos(angle), y + half_height * np.sin(angle)])


@dataclass(frozen=True)
class Drawn:
    """A matte (h, w) of 0..1 whose first pixel is column x, row y of the image."""

    matte: Matte
    x: int
    y: int


def draw(outline: Shape, width_px: float, turned: Array, centres: Array) -> Drawn:
    """Draw a shape at all the centres (B, 2) it had during the exposure. turned: (2, 2) applied to its outline."""
    corners = outline.corners @ turned.T * width_px
    low = np.floor(corners.min(axis=0) + centres.min(axis=0) - 3).astype(int)
    high = np.ceil(corners.max(axis=0) + centres.max(axis=0) + 3).astype(int)
    width, height = (high - low + 1).tolist()
    level = int(np.clip(np.floor(np.log2(MASTER_PX / (width_px * FINE))), 0, LEVELS))
    to_outline = np.linalg.inv(turned) * MASTER_PX / width_px / 2**level
    origin = (outline.centre + 0.5) / 2**level - 0.5
    total = np.zeros((height * FINE, width * FINE), np.float32)
    for centre in centres:
        # Column u of the image is centred on drawn column (u - low + 0.5) FINE - 0.5.
        first = low - 0.5 + 0.5 / FINE - centre
        affine = np.column_stack([to_outline / FINE, to_outline @ first + origin])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cv2.accumulate(cv2.warpAffine(outline.levels[level], affine, total.shape[::-1], flags=flags), total)
    # The lens blurs before the pixels average: the other way about, a thin object would snap to the rows.
    blurred = cv2.GaussianBlur(total / np.float32(len(centres)), (0, 0), LENS_BLUR_PX * FINE)
    matte = cv2.resize(blurred, (width, height), interpolation=cv2.INTER_AREA)
    return Drawn(np.asarray(matte, np.float32), int(low[0]), int(low[1]))


def steps_for(motion_px: float) -> int:
    """How many sub-exposures a motion of so many pixels needs."""
    return int(np.clip(np.ceil(motion_px / STEP_PX), 1, MOST_STEPS))
