"""Drawn flying things: three-dimensional stick models seen from anywhere, as cut-outs with an exactly known centre.

Real cut-outs show one drone and a few dozen birds. Drawn ones are poorer in texture but have every shape and aspect.
The centre of either is the centroid of its silhouette, which from any side is close to the body's own.
"""

from collections.abc import Callable
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.train.patches import UNKNOWN_CLASS, Cutout, extent

CANVAS_PX: Final = 97
SUBPIXEL_BITS: Final = 4
Points = NDArray[np.float64]
# A stroke: polyline in body coordinates (unit = half the span), thickness (same unit), opacity.
Stroke = tuple[Points, float, float]


def drone(random: np.random.Generator, phase: float) -> list[Stroke]:
    """A multicopter: arms, translucent rotor discs, a body, sometimes legs."""
    arms = int(random.choice([4, 4, 4, 6, 8]))
    angles = np.arange(arms) * 2 * np.pi / arms + np.pi / arms
    tips = np.stack([np.cos(angles), np.sin(angles), np.full(arms, 0.08)], axis=1) * 0.75
    strokes: list[Stroke] = [(np.array([[0, 0, 0], tip]), random.uniform(0.05, 0.16), 1.0) for tip in tips]
    disc_opacity = random.uniform(0.05, 0.6)
    strokes += [(tip + _disc(0.25), -1.0, disc_opacity) for tip in tips]
    long, flat = random.uniform(0.2, 0.45), random.uniform(0.1, 0.25)
    strokes += [(_line(-long, long), flat * 2, 1.0), (_line(-flat, flat, axis=2), long, 1.0)]
    if random.random() < 0.5:
        side = random.uniform(0.15, 0.35)
        down = random.uniform(0.2, 0.4)
        strokes += [(np.array([[0, s, 0], [0, s * 1.3, -down]]), 0.05, 1.0) for s in (-side, side)]
    return strokes


def bird(random: np.random.Generator, phase: float) -> list[Stroke]:
    """A body and two jointed wings at a phase of the beat."""
    lift = np.sin(phase) * random.uniform(0.2, 0.7)
    sweep = random.uniform(-0.3, 0.2)
    chord = random.uniform(0.1, 0.25)
    wing = np.array([[0, 0, 0], [0.05, 0.5, lift * 0.8], [sweep, 1.0, lift * random.uniform(0.5, 1.3)]])
    body = random.uniform(0.25, 0.5)
    return [
        (wing, chord, 1.0),
        (wing * [1, -1, 1], chord, 1.0),
        (_line(-body, body * 0.7), random.uniform(0.12, 0.22), 1.0),
    ]


def aeroplane(random: np.random.Generator, phase: float) -> list[Stroke]:
    """Fuselage, swept wings, tail."""
    long, sweep = random.uniform(0.7, 1.1), random.uniform(0, 0.5)
    chord = random.uniform(0.08, 0.2)
    wing = np.array([[0.1, 0, 0], [0.1 - sweep, 1.0, 0.08]])
    tail = np.array([[-long, 0, 0.05], [-long - 0.1, 0.35, 0.05]])
    fin = np.array([[-long + 0.1, 0, 0], [-long - 0.05, 0, 0.35]])
    mirrored = [1, -1, 1]
    return [
        (wing, chord, 1.0),
        (wing * mirrored, chord, 1.0),
        (tail, chord * 0.7, 1.0),
        (tail * mirrored, chord * 0.7, 1.0),
        (fin, chord, 1.0),
        (_line(-long, long), random.uniform(0.12, 0.2), 1.0),
    ]


def helicopter(random: np.random.Generator, phase: float) -> list[Stroke]:
    """A cabin, a boom, a rotor."""
    body = random.uniform(0.3, 0.5)
    rotor = np.array([[np.cos(phase), np.sin(phase), 0], [-np.cos(phase), -np.sin(phase), 0]]) * 0.9 + [0, 0, 0.35]
    return [
        (_line(-body * 0.6, body), random.uniform(0.3, 0.45), 1.0),
        (_line(-1.1, 0), random.uniform(0.06, 0.12), 1.0),
        (np.array([[-1.1, 0, 0], [-1.15, 0, 0.3]]), 0.08, 1.0),
        (rotor, 0.04, 0.8),
        (_disc(0.9) + np.array([0, 0, 0.35]), -1.0, random.uniform(0.0, 0.25)),
    ]


def speck(random: np.random.Generator, phase: float) -> list[Stroke]:
    """A rounded lump that could be anything."""
    return [(_line(-1, 1) * random.uniform(0.1, 0.8), random.uniform(0.5, 1.2), 1.0)]


MODELS: Final[dict[int, Callable[[np.random.Generator, float], list[Stroke]]]] = {
    0: drone,
    1: bird,
    2: aeroplane,
    3: helicopter,
    UNKNOWN_CLASS: speck,
}


def draw(label: int, random: np.random.Generator) -> tuple[Cutout, ...]:
    """Three views of one drawn object, newest first: the same body a little turned, its wings or rotor further on."""
    seed, phase = int(random.integers(2**31)), random.uniform(0, 2 * np.pi)
    step = random.uniform(0, 3)
    view, turn = _attitude(label, random), random.normal(0, 0.06, 3)
    grey, shade = random.uniform(5, 250), random.uniform(-30, 30)
    views = []
    for k in range(3):
        strokes = MODELS[label](np.random.default_rng(seed), phase - k * step)
        views.append(_render(strokes, view @ cv2.Rodrigues(turn * k)[0], grey, shade))
    return tuple(views)


def _attitude(label: int, random: np.random.Generator) -> Points:
    """`R_image_body`: any heading, seen from a ground camera at any elevation, with a bank that suits the class."""
    heading, elevation = random.uniform(0, 2 * np.pi), np.arcsin(random.uniform(-0.1, 0.9))
    bank = random.normal(0, 0.15 if label == 0 else 0.4)
    turn = cv2.Rodrigues(np.array([0, 0, heading]))[0] @ cv2.Rodrigues(np.array([bank, 0, 0]))[0]
    side, up = np.sin(elevation), np.cos(elevation)
    # Image axes: u to the right, v down, looking up at the body from `elevation` below it.
    look = np.array([[1, 0, 0], [0, side, -up], [0, up, side]])
    return np.asarray(look @ turn)


def _render(strokes: list[Stroke], R_image_body: Points, grey: float, shade: float) -> Cutout:
    middle, unit = (CANVAS_PX - 1) / 2, (CANVAS_PX - 9) / 2 / 1.25
    matte = np.zeros((CANVAS_PX, CANVAS_PX), np.float32)
    for points, thickness, opacity in strokes:
        layer = np.zeros((CANVAS_PX, CANVAS_PX), np.uint8)
        uv = (points @ R_image_body.T)[:, :2] * unit + middle
        fixed = np.round(uv * 2**SUBPIXEL_BITS).astype(np.int32)
        if thickness < 0:
            cv2.fillPoly(layer, [fixed], 255, cv2.LINE_AA, SUBPIXEL_BITS)
        else:
            cv2.polylines(layer, [fixed], False, 255, max(round(thickness * unit), 1), cv2.LINE_AA, SUBPIXEL_BITS)
        matte = np.maximum(matte, layer.astype(np.float32) * (opacity / 255))
    gradient = np.linspace(-shade, shade, CANVAS_PX, dtype=np.float32)[:, None]
    size = (extent(matte.sum(axis=0)), extent(matte.sum(axis=1)))
    paint = matte * np.clip(grey + gradient, 0, 255)
    solid = np.minimum(matte * 2, 1)  # a rotor disc that the sky shines through is area all the same
    centre = tuple(float((solid.sum(axis=axis) * np.arange(CANVAS_PX)).sum() / solid.sum()) for axis in (0, 1))
    return Cutout(matte, paint.astype(np.float32), (centre[0], centre[1]), size, (centre[0], centre[1]))


def _disc(radius: float) -> Points:
    angle = np.linspace(0, 2 * np.pi, 17)[:-1]
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(16)], axis=1) * radius


def _line(start: float, end: float, axis: int = 0) -> Points:
    points = np.zeros((2, 3))
    points[:, axis] = start, end
    return points
