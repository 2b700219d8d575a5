"""One training sample after another: a background, objects on it at exact places, then the camera's own faults.

Everything a box will meet and the clips do not show is made here: objects 2 px wide, speeds from hover to bird,
motion blur, low contrast, noise, compression, a shaken tripod, a stream whose older frames are missing.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from tools.train.footage import Material
from tools.train.patches import CLASSES, UNKNOWN_CLASS, Box, Cutout, Floats, Grey
from tools.train.silhouettes import draw

CROP_PX: Final = 96  # larger than the 64 px crops of the box, so that most cells see no border
MAX_BOXES: Final = 4
DRAWN: Final = 1500  # silhouettes drawn beforehand; drawing one costs as much as ten samples
SMALLEST_PX: Final = 2.0
LARGEST_PX: Final = 44.0  # of a pasted object's longer side: beyond it a 64 px crop holds no background
FASTEST_PX: Final = 25.0  # per 100 ms: the 99th percentile of birds in 640 px footage


@dataclass(frozen=True)
class Mix:
    """How often each kind of sample is made; the rest is on a drawn sky."""

    real_patch: float = 0.40
    real_background: float = 0.38
    drawn_cutout: float = 0.4
    empty: float = 0.2


class Composer:
    """Draws samples from training material; the same seed gives the same samples."""

    def __init__(self, material: Material, seed: int, mix: Mix | None = None) -> None:
        self.random = np.random.default_rng(seed)
        self.mix = mix or Mix()
        self.material = material
        self.prefer_backgrounds(np.ones(len(material.backgrounds), np.float32))
        labels = list(range(len(CLASSES))) + [UNKNOWN_CLASS]
        share = [0.4, 0.2, 0.15, 0.1, 0.15]
        drawn = self.random.choice(labels, DRAWN, p=share)
        self.drawn = [(draw(int(label), self.random), int(label)) for label in drawn]
        self.patches_by_class = _by_class([(patch, patch.boxes[0].label) for patch in material.patches])
        self.cutouts_by_class = _by_class([(cutout, cutout[1]) for cutout in material.cutouts])

    def batch(self, count: int) -> tuple[Grey, Floats]:
        """`(B, S, S, 3)` uint8 stacks and `(B, MAX_BOXES, 7)` boxes: x, y, width, height px, class, exact, present."""
        stacks = np.empty((count, CROP_PX, CROP_PX, 3), np.uint8)
        boxes = np.zeros((count, MAX_BOXES, 7), np.float32)
        for k in range(count):
            stacks[k], found = self.sample()
            for m, box in enumerate(found[:MAX_BOXES]):
                boxes[k, m] = box.x_px, box.y_px, box.width_px, box.height_px, box.label, box.exact, 1
        return stacks, boxes

    def sample(self) -> tuple[Grey, list[Box]]:
        """One stack and the objects whose centres lie in it."""
        random = self.random
        kind = random.random()
        boxes: list[Box] = []
        if kind < self.mix.real_patch and self.patches_by_class:
            patch = _pick(self.patches_by_class, random)
            image, boxes = self._crop(patch.stack, patch.boxes)
            pastes = int(random.random() < 0.15)
        else:
            real = kind < self.mix.real_patch + self.mix.real_background and bool(self.material.backgrounds)
            image = self._real_background() if real else self._drawn_sky()
            pastes = 0 if random.random() < self.mix.empty else int(random.choice([1, 1, 2]))
        for _ in range(pastes):
            self._paste(image, boxes)
        return self._camera(image), boxes

    def _real_background(self) -> Floats:
        k = int(np.searchsorted(self.background_share, self.random.random() * self.background_share[-1]))
        return self._crop(self.material.backgrounds[k], ())[0]

    def prefer_backgrounds(self, weights: Floats) -> None:
        """Draw backgrounds in proportion to `(N,)` weights: those that fooled a half-trained net, more often."""
        self.background_share = np.cumsum(weights)

    def _crop(self, stack: Grey, boxes: tuple[Box, ...]) -> tuple[Floats, list[Box]]:
        """A flipped, slightly zoomed CROP_PX window that holds the first box, or lies anywhere if there is none."""
        random = self.random
        zoom = random.uniform(0.8, 1.2)
        flip = -1.0 if random.random() < 0.5 else 1.0
        half = (CROP_PX - 1) / 2
        if boxes:
            reach = CROP_PX / 2 - 3
            middle = np.array([boxes[0].x_px, boxes[0].y_px]) + random.uniform(-reach, reach, 2) / zoom
        else:
            free = np.maximum(np.array(stack.shape[1::-1]) - CROP_PX / zoom, 0)
            middle = np.array(stack.shape[1::-1]) / 2 + random.uniform(-0.5, 0.5, 2) * free
        to_crop = np.array(
            [[flip * zoom, 0, half - flip * zoom * middle[0]], [0, zoom, half - zoom * middle[1]]], np.float64
        )
        image = cv2.warpAffine(
            stack, to_crop, (CROP_PX, CROP_PX), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
        )
        placed = []
        for box in boxes:
            x, y = to_crop @ [box.x_px, box.y_px, 1]
            if 0 <= x < CROP_PX and 0 <= y < CROP_PX:
                placed.append(Box(x, y, box.width_px * zoom, box.height_px * zoom, box.label, box.exact))
        return image.astype(np.float32), placed

    def _drawn_sky(self) -> Floats:
        """A gradient with cloud of a random coarseness, drifting a little from frame to frame."""
        random = self.random
        v, u = np.mgrid[0:CROP_PX, 0:CROP_PX].astype(np.float32) / CROP_PX
        base = random.uniform(60, 230) + random.normal(0, 25) * u + random.normal(0, 25) * v
        cells = int(random.choice([3, 6, 12, 24]))
        coarse = random.normal(0, random.choice([0, 3, 8, 20]), (cells, cells)).astype(np.float32)
        cloud = cv2.resize(coarse, (CROP_PX + 4, CROP_PX + 4), interpolation=cv2.INTER_CUBIC)
        drift = random.uniform(-1, 1, 2)
        layers = []
        for k in range(3):
            move = np.array([[1, 0, -2 + drift[0] * k], [0, 1, -2 + drift[1] * k]])
            layers.append(base + cv2.warpAffine(cloud, move, (CROP_PX, CROP_PX), borderMode=cv2.BORDER_REFLECT))
        return np.stack(layers, axis=2)

    def _paste(self, image: Floats, boxes: list[Box]) -> None:
        """Set one object on the image, in motion, and add its box."""
        random = self.random
        if random.random() < self.mix.drawn_cutout or not self.cutouts_by_class:
            views, label = self.drawn[int(random.integers(len(self.drawn)))]
        else:
            views, label = _pick(self.cutouts_by_class, random)
        longest = max(views[0].size_px)
        largest = LARGEST_PX if label == UNKNOWN_CLASS else min(LARGEST_PX, longest * 1.3)
        scale = float(np.exp(random.uniform(np.log(SMALLEST_PX), np.log(max(largest, SMALLEST_PX + 1))))) / longest
        place = random.uniform(3, CROP_PX - 4, 2)
        if any(abs(place[0] - b.x_px) < 8 + b.width_px and abs(place[1] - b.y_px) < 8 + b.height_px for b in boxes):
            return
        mirror = -1.0 if random.random() < 0.5 else 1.0
        velocity = self._velocity()
        look = self._look(views[0], image, place)
        smear = velocity * random.uniform(0, 0.2) if random.random() < 0.4 else np.zeros(2)
        for k, view in enumerate(views):
            _lay(image[:, :, k], view, place - velocity * k, (scale * mirror, scale), smear, look)
        size = [max(s * scale + abs(m), 1.0) for s, m in zip(views[0].size_px, smear, strict=True)]
        boxes.append(Box(float(place[0]), float(place[1]), size[0], size[1], label, exact=True))

    def _velocity(self) -> Floats:
        """Pixels per 100 ms."""
        if self.random.random() < 0.1:
            return np.zeros(2, np.float32)
        speed = np.exp(self.random.uniform(np.log(0.15), np.log(FASTEST_PX)))
        angle = self.random.uniform(0, 2 * np.pi)
        return np.array([np.cos(angle), np.sin(angle)], np.float32) * speed

    def _look(self, view: Cutout, image: Floats, place: Floats) -> tuple[float, float, float]:
        """Opacity, gain and offset of the paint. An object that would vanish against its background is turned round."""
        behind = float(image[int(place[1]), int(place[0]), 0])
        grey = float(view.paint.sum() / view.matte.sum())
        opacity = self.random.uniform(0.45, 1.0)
        gain, offset = self.random.uniform(0.7, 1.3), self.random.normal(0, 15)
        contrast = (grey * gain + offset - behind) * opacity
        weakest = 12.0
        if abs(contrast) < weakest:
            push = float(self.random.uniform(weakest, 60)) / opacity
            offset += (push if contrast > 0 else -push) - contrast / opacity
        return opacity, gain, offset

    def _camera(self, image: Floats) -> Grey:
        """What the camera adds: shake, blur, exposure, noise, compression, and frames it did not deliver."""
        random = self.random
        if random.random() < 0.15:
            for k in (1, 2):
                move = np.eye(2, 3)
                move[:, 2] = random.normal(0, 0.4, 2)
                image[:, :, k] = cv2.warpAffine(image[:, :, k], move, (CROP_PX, CROP_PX), borderMode=cv2.BORDER_REFLECT)
        if random.random() < 0.3:
            image = cv2.GaussianBlur(image, (0, 0), random.uniform(0.3, 1.0))
        image = (image - 128) * random.uniform(0.6, 1.3) + 128 + random.normal(0, 15)
        sigma = float(np.exp(random.uniform(np.log(0.2), np.log(7))))
        image = image + random.standard_normal(image.shape, np.float32) * np.float32(sigma)
        stack: Grey = np.clip(image + 0.5, 0, 255).astype(np.uint8)
        if random.random() < 0.25:
            quality = [cv2.IMWRITE_JPEG_QUALITY, int(random.integers(35, 92))]
            for k in range(3):
                stack[:, :, k] = cv2.imdecode(cv2.imencode(".jpg", stack[:, :, k], quality)[1], cv2.IMREAD_GRAYSCALE)
        if random.random() < 0.04:
            stack[:, :, 1:] = stack[:, :, :1]
        return stack


def _by_class(items: list[tuple[object, int]]) -> dict[int, list]:  # type: ignore[type-arg]
    found: dict[int, list] = {}  # type: ignore[type-arg]
    for item, label in items:
        found.setdefault(label, []).append(item)
    return found


def _pick(by_class: dict[int, list], random: np.random.Generator):  # type: ignore[no-untyped-def,type-arg]
    """One of a class drawn with the square root of its size: the rare are seen more often, not worn out."""
    labels = sorted(by_class)
    weight = np.sqrt([len(by_class[label]) for label in labels])
    items = by_class[int(random.choice(labels, p=weight / weight.sum()))]
    return items[int(random.integers(len(items)))]


def _lay(
    channel: Floats,
    view: Cutout,
    place: Floats,
    scale: tuple[float, float],
    smear: Floats,
    look: tuple[float, float, float],
) -> None:
    """Blend a cut-out into one frame: its centre at `place`, shrunk by area so that no energy is lost or aliased."""
    opacity, gain, offset = look
    matte, paint, centre = view.matte, view.paint, np.array(view.centre_px)
    factor = max(int(1 / scale[1]), 1)
    if factor > 1:
        matte, paint = _shrink(matte, factor), _shrink(paint, factor)
        centre = (centre + 0.5) / factor - 0.5
    x_scale, y_scale = scale[0] * factor, scale[1] * factor
    reach = int(
        max(matte.shape) * y_scale / 2 + abs(smear).max() + 3 + max(abs(centre - np.array(matte.shape[::-1]) / 2))
    )
    x0, y0 = max(int(place[0]) - reach, 0), max(int(place[1]) - reach, 0)
    x1, y1 = min(int(place[0]) + reach + 2, channel.shape[1]), min(int(place[1]) + reach + 2, channel.shape[0])
    if x1 <= x0 or y1 <= y0:
        return
    blur = [(0.0, 0.0)] if not smear.any() else [(f * smear[0], f * smear[1]) for f in (-0.5, 0.0, 0.5)]
    alpha = np.zeros((y1 - y0, x1 - x0), np.float32)
    ink = np.zeros_like(alpha)
    for dx, dy in blur:
        x, y = place[0] + dx - x0, place[1] + dy - y0
        move = np.array([[x_scale, 0, x - x_scale * centre[0]], [0, y_scale, y - y_scale * centre[1]]])
        alpha += cv2.warpAffine(matte, move, alpha.shape[::-1]) / len(blur)
        ink += cv2.warpAffine(paint, move, alpha.shape[::-1]) / len(blur)
    part = channel[y0:y1, x0:x1]
    part += opacity * (ink * gain + alpha * offset - alpha * part)


def _shrink(image: Floats, factor: int) -> Floats:
    height, width = (-(-n // factor) * factor for n in image.shape)
    padded = cv2.copyMakeBorder(image, 0, height - image.shape[0], 0, width - image.shape[1], cv2.BORDER_CONSTANT)
    return cv2.resize(padded, (width // factor, height // factor), interpolation=cv2.INTER_AREA)
