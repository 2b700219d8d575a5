"""Drawn backgrounds: sky with drifting cloud, and foliage that sways, which is what a net must learn not to report."""

from typing import Final

import cv2
import numpy as np

from tools.train.patches import Floats

FRAMES: Final = 3
SWAY_PX: Final = 3.0  # of twigs between two frames of a stack, at most


def sky(size_px: int, random: np.random.Generator) -> Floats:
    """`(S, S, 3)` grey: a gradient with cloud of a random coarseness, drifting a little from frame to frame."""
    v, u = np.mgrid[0:size_px, 0:size_px].astype(np.float32) / size_px
    base = random.uniform(60, 230) + random.normal(0, 25) * u + random.normal(0, 25) * v
    cells = int(random.choice([3, 6, 12, 24]))
    coarse = random.normal(0, random.choice([0, 3, 8, 20]), (cells, cells)).astype(np.float32)
    cloud = cv2.resize(coarse, (size_px + 4, size_px + 4), interpolation=cv2.INTER_CUBIC)
    drift = random.uniform(-1, 1, 2)
    layers = []
    for k in range(FRAMES):
        move = np.array([[1, 0, -2 + drift[0] * k], [0, 1, -2 + drift[1] * k]])
        layers.append(base + cv2.warpAffine(cloud, move, (size_px, size_px), borderMode=cv2.BORDER_REFLECT))
    return np.stack(layers, axis=2)


def foliage(size_px: int, random: np.random.Generator) -> Floats:
    """`(S, S, 3)` grey: leaves below a ragged edge, each part swaying in its own way, sky above and in the gaps."""
    image = sky(size_px, random)
    leaves = _texture(size_px, random.uniform(0.2, 1.2), random)
    picture = random.uniform(15, 130) + random.uniform(8, 35) * leaves
    v = np.linspace(0, 1, size_px, dtype=np.float32)[:, None]
    edge = random.uniform(-0.6, 0.9) + random.uniform(0.05, 0.3) * _texture(size_px, 1.5, random)[:1]
    gaps = random.uniform(0.05, 0.4) * _texture(size_px, random.uniform(0.4, 1.0), random)
    matte = np.clip((v - edge + gaps) * random.uniform(8, 40), 0, 1).astype(np.float32)
    sway = [_texture(size_px, slope, random) * random.uniform(0.1, SWAY_PX) for slope in (2.0, 1.3)]
    columns, rows = np.meshgrid(np.arange(size_px, dtype=np.float32), np.arange(size_px, dtype=np.float32))
    phase = random.uniform(-1, 1, (FRAMES, 2)).astype(np.float32)
    for k in range(FRAMES):
        u = columns + phase[k, 0] * sway[0] + phase[k, 1] * sway[1]
        cover = cv2.remap(matte, u, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        shown = cv2.remap(picture.astype(np.float32), u, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        image[:, :, k] += cover * (shown - image[:, :, k])
    return image


def _texture(size_px: int, slope: float, random: np.random.Generator) -> Floats:
    """`(S, S)` noise whose octaves grow with their size to the power `slope`; mean about 0, sigma about 1."""
    total = np.zeros((size_px, size_px), np.float32)
    power = 0.0
    grain = 1
    while size_px // grain >= 3:
        cells = -(-size_px // grain)
        octave = random.standard_normal((cells, cells), np.float32)
        total += grain**slope * cv2.resize(octave, (size_px, size_px), interpolation=cv2.INTER_LINEAR)
        power += grain ** (2 * slope)
        grain *= 2
    return total / np.float32(np.sqrt(power))
