"""What a distant flying thing looks like: a few dark polygons, drawn to a hundredth of a pixel.

The hazard is a picture whose centre is not where the label says: a detector trained or measured on it would learn the
error. So every shape is centred on its own area, drawn at several times the resolution of the image, and averaged over
the positions it had while the shutter was open.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.lens import Array

FINE: Final = 8  # drawn pixels per image pixel: an edge is right to a sixteenth of a pixel
LARGE_PX: Final = 48.0  # objects wider than this are drawn 4 times finer only: their edges are many
LENS_BLUR_PX: Final = 0.55  # one sigma of an ordinary lens in focus
STEP_PX: Final = 0.5  # motion a sub-exposure may make: shorter steps cannot be told from a smear
MOST_STEPS: Final = 24
SHIFT: Final = 6  # binary places of a polygon's corners
FLAP_PHASES: Final = 16  # wing positions kept; finer ones differ by less than a pixel on any bird drawn here

Matte = NDArray[np.float32]


@dataclass(frozen=True)
class Shape:
    """Polygons in units of the object's width, centred on their area, y down. opacity: 0..1 for each."""

    polygons: tuple[Array, ...]
    opacity: tuple[float, ...]


@lru_cache(maxsize=64)
def shape(kind: str, aspect: float, phase: int = 0) -> Shape:
    """The outline of a kind of object; aspect: height over width; phase: of the wings, 0 to FLAP_PHASES - 1."""
    polygons, opacity = _OUTLINES[kind](aspect, 2 * np.pi * phase / FLAP_PHASES)
    centre = _area_centre(polygons)
    return Shape(tuple(polygon - centre for polygon in polygons), opacity)


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


def _area_centre(polygons: list[Array]) -> Array:
    """Centre of the area the polygons cover together, in their own units."""
    scale, middle = 1000.0, 1024
    canvas = np.zeros((2 * middle, 2 * middle), np.uint8)
    for polygon in polygons:
        cv2.fillPoly(canvas, [np.round(polygon * scale + middle).astype(np.int32)], 1)
    moments = cv2.moments(canvas, binaryImage=True)
    centre: Array = (np.array([moments["m10"], moments["m01"]]) / moments["m00"] - middle) / scale
    return centre


@dataclass(frozen=True)
class Drawn:
    """A matte (h, w) of 0..1 whose first pixel is column x, row y of the image."""

    matte: Matte
    x: int
    y: int


def draw(outline: Shape, width_px: float, turned: Array, centres: Array) -> Drawn:
    """Draw a shape at all the centres (B, 2) it had during the exposure. turned: (2, 2) applied to its outline."""
    fine = FINE if width_px < LARGE_PX else FINE // 4
    polygons = [polygon @ turned.T * width_px for polygon in outline.polygons]
    corners = np.vstack(polygons)
    low = np.floor((corners.min(axis=0) + centres.min(axis=0)) - 3).astype(int)
    high = np.ceil((corners.max(axis=0) + centres.max(axis=0)) + 3).astype(int)
    width, height = (high - low + 1).tolist()
    total = np.zeros((height * fine, width * fine), np.float32)
    for centre in centres:
        once = np.zeros(total.shape, np.uint8)
        for polygon, opacity in zip(polygons, outline.opacity, strict=True):
            # Column u of the image is centred on drawn column (u + 0.5) fine - 0.5.
            at = (polygon + centre - low + 0.5) * fine - 0.5
            one = np.zeros_like(once) if opacity < 1 else once
            cv2.fillPoly(one, [np.round(at * (1 << SHIFT)).astype(np.int32)], round(255 * opacity), cv2.LINE_8, SHIFT)
            if one is not once:
                cv2.max(once, one, once)
        cv2.accumulate(once, total)
    matte = cv2.resize(total, (width, height), interpolation=cv2.INTER_AREA) / (255.0 * len(centres))
    return Drawn(cv2.GaussianBlur(matte, (0, 0), LENS_BLUR_PX), int(low[0]), int(low[1]))


def steps_for(motion_px: float) -> int:
    """How many sub-exposures a motion of so many pixels needs."""
    return int(np.clip(np.ceil(motion_px / STEP_PX), 1, MOST_STEPS))
