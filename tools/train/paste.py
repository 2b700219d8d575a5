"""Set a cut-out on a background: at an exact sub-pixel place, at any size, in motion, with a contrast that shows."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.train.patches import Cutout, Floats

WEAKEST_CONTRAST: Final = 12.0  # grey levels over the background's own scatter: fainter, nobody could label it
STRONGEST_PUSH: Final = 60.0  # grey levels that a faint object is moved away from its background
FASTEST_PX: Final = 25.0  # per 100 ms: the 99th percentile of birds in 640 px footage
FASTEST_LENGTHS: Final = 4.0  # of its own, per 100 ms: a small drone at 15 m/s
INSECT_LENGTHS: Final = (6.0, 25.0)  # per 100 ms: what crosses so many is an insect near the lens
FINE: Final = 2  # a pixel's parts along a side when an object is drawn
SMEAR_STEPS: Final = (-0.5, 0.0, 0.5)  # places of an object during the exposure, as shares of the smear

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Look:
    """How the paint of a cut-out is changed: share that covers, factor and shift of its grey."""

    opacity: float
    gain: float
    offset: float


def visible_look(view: Cutout, behind: float, scatter: float, random: np.random.Generator) -> Look:
    """A random look, pushed away from the grey `behind` it and that one's `scatter` if it would vanish in them."""
    grey = float(view.paint.sum() / view.matte.sum())
    opacity = random.uniform(0.45, 1.0)
    gain, offset = random.uniform(0.7, 1.3), random.normal(0, 15)
    contrast = (grey * gain + offset - behind) * opacity
    weakest = WEAKEST_CONTRAST + scatter
    if abs(contrast) < weakest:
        push = float(random.uniform(weakest, scatter + STRONGEST_PUSH)) / opacity
        offset += (push if contrast > 0 else -push) - contrast / opacity
    return Look(opacity, gain, offset)


def velocity(length_px: float, random: np.random.Generator) -> Vector:
    """`(2,)` pixels per 100 ms of an object so long: one in ten hovers, the rest from a crawl to a bird close by."""
    if random.random() < 0.1:
        return np.zeros(2)
    fastest = min(FASTEST_PX, FASTEST_LENGTHS * length_px)
    return _any_way(np.exp(random.uniform(np.log(0.15), np.log(fastest))), random)


def insect_velocity(length_px: float, random: np.random.Generator) -> Vector:
    """`(2,)` pixels per 100 ms of an insect so long."""
    return _any_way(length_px * random.uniform(*INSECT_LENGTHS), random)


def _any_way(speed: float, random: np.random.Generator) -> Vector:
    angle = random.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle) * speed, np.sin(angle) * speed])


@dataclass(frozen=True)
class Pose:
    """Where a cut-out is set: centre (u, v) px, horizontal (negative: mirrored) and vertical scale, motion blur px."""

    place: Vector
    scale: tuple[float, float]
    smear: Vector


def lay(channel: Floats, view: Cutout, pose: Pose, look: Look) -> None:
    """Blend a cut-out into a frame `(H, W)`, in place.

    Drawn FINE times finer and averaged, as a pixel does it: nothing is aliased, and what is one pixel wide stays it.
    """
    place, scale, smear = pose.place, (pose.scale[0] * FINE, pose.scale[1] * FINE), pose.smear
    matte, paint, centre = view.matte, view.paint, np.array(view.centre_px)
    factor = max(int(1 / scale[1]), 1)
    if factor > 1:
        matte, paint = _shrink(matte, factor), _shrink(paint, factor)
        centre = (centre + 0.5) / factor - 0.5
    x_scale, y_scale = scale[0] * factor, scale[1] * factor
    off_centre = max(abs(centre - np.array(matte.shape[::-1]) / 2))
    reach = int(max(matte.shape) * y_scale / 2 / FINE + abs(smear).max() + 3 + off_centre)
    low = np.maximum(place.astype(int) - reach, 0)
    high = np.minimum(place.astype(int) + reach + 2, channel.shape[::-1])
    if (high <= low).any():
        return
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    fine_px = (size[0] * FINE, size[1] * FINE)
    steps = SMEAR_STEPS if smear.any() else (0.0,)
    cover, ink = np.zeros(fine_px[::-1], np.float32), np.zeros(fine_px[::-1], np.float32)
    for step in steps:
        x, y = (place + step * smear - low + 0.5) * FINE - 0.5
        move = np.array([[x_scale, 0, x - x_scale * centre[0]], [0, y_scale, y - y_scale * centre[1]]])
        cover += cv2.warpAffine(matte, move, fine_px) / len(steps)
        ink += cv2.warpAffine(paint, move, fine_px) / len(steps)
    cover, ink = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (cover, ink))
    part = channel[low[1] : high[1], low[0] : high[0]]
    part += look.opacity * (ink * look.gain + cover * look.offset - cover * part)


def _shrink(image: Floats, factor: int) -> Floats:
    height, width = (-(-n // factor) * factor for n in image.shape)
    padded = cv2.copyMakeBorder(image, 0, height - image.shape[0], 0, width - image.shape[1], cv2.BORDER_CONSTANT)
    small = cv2.resize(padded, (width // factor, height // factor), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)
