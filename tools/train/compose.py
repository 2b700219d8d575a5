"""One training sample after another: a background, objects on it at exact places, then the camera's own faults.

Everything a box will meet and the clips do not show is made here: objects 2 px wide before leaves and clouds, speeds
from hover to bird, motion blur, low contrast. A net that is shown an object in every picture learns to find one in
every picture: so many samples hold none, and those places that fool it come back more often. What it must find has to
be findable: a faint speck taught as an object among leaves teaches it to report leaves, and an insect that crosses the
lens in a tenth of a second is no aircraft.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np

from tools.train.backdrops import foliage, sky
from tools.train.camera import expose, noise
from tools.train.footage import Material
from tools.train.paste import Pose, Vector, insect_velocity, lay, velocity, visible_look
from tools.train.patches import CLASSES, UNKNOWN_CLASS, Box, Cutout, Floats, Grey
from tools.train.silhouettes import draw
from tools.train.visible import visible
from tools.train.windows import CROP_PX, crop

MAX_BOXES: Final = 4
BOX_VALUES: Final = 9
DRAWN: Final = 1500  # silhouettes drawn beforehand; drawing one costs as much as ten samples
DRAWN_SHARE: Final = (0.25, 0.2, 0.2, 0.2, 0.15)  # of drones, birds, aeroplanes, helicopters, specks
SMALLEST_PX: Final = 2.0
LARGEST_PX: Final = 44.0  # of a pasted object's longer side: beyond it a 64 px crop holds no background
LARGEST_ZOOM: Final = 1.3  # of a cut-out: enlarged more, it is softer than anything a lens makes
APART_PX: Final = 8  # between two objects: closer, they share a peak of the net
TEXTURE_PX: Final = 10  # about a place: where the background's scatter is measured
LEAFY: Final = 15.0  # grey levels of scatter among which an object is twice SMALLEST_PX at least
NOISY: Final = 3.0  # times the camera's noise an object must differ by, to be seen through it
INSECT_PX: Final = (1.5, 6.0)

Views = tuple[tuple[Cutout, ...], int]
Item = TypeVar("Item")


@dataclass(frozen=True)
class Mix:
    """How often each kind of sample is made; the rest is on a drawn background."""

    patch: float = 0.38  # filmed or rendered, its object in place
    background: float = 0.42  # filmed or rendered, objects set on it
    foliage: float = 0.5  # of the drawn backgrounds
    drawn_cutout: float = 0.4  # of the objects set on a background
    empty: float = 0.45  # of the backgrounds
    second: float = 0.15  # of the patches: those that get another object
    insects: float = 0.12  # of all samples: those that an insect or two fly through
    as_filmed: float = 0.4  # of the patches: those that have their camera's faults and no more
    spot: float = 0.6  # of the backgrounds with a known worst place: those cut out about it


class Composer:
    """Draws samples from training material; the same seed gives the same samples."""

    def __init__(self, material: Material, seed: int, mix: Mix | None = None) -> None:
        self.random = np.random.default_rng(seed)
        self.mix = mix or Mix()
        self.backgrounds = material.backgrounds
        self.prefer_backgrounds(np.ones(len(material.backgrounds), np.float32))
        drawn = self.random.choice([*range(len(CLASSES)), UNKNOWN_CLASS], DRAWN, p=DRAWN_SHARE)
        self.drawn: list[Views] = [(draw(int(label), self.random), int(label)) for label in drawn]
        self.patches = _by_class(material.patches, [patch.boxes[0].label for patch in material.patches])
        self.cutouts = _by_class(material.cutouts, [label for _, label in material.cutouts])

    def prefer_backgrounds(self, weights: Floats, spots: Floats | None = None) -> None:
        """Draw backgrounds in proportion to `(N,)` weights: those that fooled a half-trained net, more often.

        spots: `(N, 2)` px, the place in each that fools it most.
        """
        self._background_share = np.cumsum(weights)
        self._spots = spots

    def batch(self, count: int) -> tuple[Grey, Floats]:
        """`(B, S, S, 3)` stacks and `(B, MAX_BOXES, BOX_VALUES)` boxes.

        Values of a box: x, y, width, height px, class, exact, telling, present, visible.
        """
        stacks = np.empty((count, CROP_PX, CROP_PX, 3), np.uint8)
        boxes = np.zeros((count, MAX_BOXES, BOX_VALUES), np.float32)
        for k in range(count):
            stacks[k], found = self.sample()
            for m, box in enumerate(found[:MAX_BOXES]):
                size = (box.width_px, box.height_px)
                seen = visible(stacks[k], box)
                boxes[k, m] = box.x_px, box.y_px, *size, box.label, box.exact, box.telling, 1, seen
        return stacks, boxes

    def sample(self) -> tuple[Grey, list[Box]]:
        """One stack and the objects whose centres lie in it."""
        kind = self.random.random()
        sigma = noise(self.random)
        boxes: list[Box] = []
        filmed = kind < self.mix.patch and bool(self.patches)
        if filmed:
            patch = _pick(self.patches, self.random)
            image, boxes = crop(patch.stack, patch.boxes, self.random)
            pastes = int(self.random.random() < self.mix.second)
        else:
            real = kind < self.mix.patch + self.mix.background and bool(self.backgrounds)
            image = self._background() if real else self._drawn_background()
            pastes = 0 if self.random.random() < self.mix.empty else int(self.random.choice([1, 1, 2]))
        for _ in range(pastes):
            self._paste(image, boxes, sigma)
        if self.random.random() < self.mix.insects:
            self._insects(image, sigma)
        return self._taken(image, sigma, filmed=filmed), boxes

    def _taken(self, image: Floats, sigma: float, *, filmed: bool) -> Grey:
        """The picture a camera takes of it; what was filmed has a camera's faults already and may get no more."""
        if filmed and self.random.random() < self.mix.as_filmed:
            return np.asarray(np.clip(image + 0.5, 0, 255), np.uint8)
        return expose(image, sigma, self.random)

    def _background(self) -> Floats:
        k = int(np.searchsorted(self._background_share, self.random.random() * self._background_share[-1]))
        spot = self._spots[k] if self._spots is not None and self.random.random() < self.mix.spot else None
        return crop(self.backgrounds[k], (), self.random, about=spot)[0]

    def _drawn_background(self) -> Floats:
        return (foliage if self.random.random() < self.mix.foliage else sky)(CROP_PX, self.random)

    def _paste(self, image: Floats, boxes: list[Box], sigma: float) -> None:
        """Set one object on the image, in motion, and add its box; none where there is one already."""
        random = self.random
        views, label = self._views()
        longest = max(views[0].size_px)
        largest = LARGEST_PX if label == UNKNOWN_CLASS else min(LARGEST_PX, longest * LARGEST_ZOOM)
        place = random.uniform(3, CROP_PX - 4, 2)
        if any(_near(box, place[0], place[1]) for box in boxes):
            return
        smallest = SMALLEST_PX * (1 + min(_scatter(image, place) / LEAFY, 1))
        length = float(np.exp(random.uniform(np.log(smallest), np.log(max(largest, smallest + 1)))))
        smear = self._fly(image, views, place, velocity(length, random), scale=length / longest, sigma=sigma)
        scale = length / longest
        width, height = (max(s * scale + abs(m), 1.0) for s, m in zip(views[0].size_px, smear, strict=True))
        boxes.append(Box(float(place[0]), float(place[1]), float(width), float(height), label, exact=1.0))

    def _fly(
        self, image: Floats, views: tuple[Cutout, ...], place: Vector, motion: Vector, *, scale: float, sigma: float
    ) -> Vector:
        """Lay an object where it is and was, to be seen through noise of `sigma`; its motion blur `(2,)` px."""
        random = self.random
        mirror = -1.0 if random.random() < 0.5 else 1.0
        behind = float(image[int(place[1]), int(place[0]), 0])
        look = visible_look(views[0], behind, _scatter(image, place) + NOISY * sigma, random)
        smear: Vector = motion * random.uniform(0, 0.2) if random.random() < 0.4 else np.zeros(2)
        for k, view in enumerate(views):
            lay(image[:, :, k], view, Pose(place - motion * k, (scale * mirror, scale), smear), look)
        return smear

    def _insects(self, image: Floats, sigma: float) -> None:
        """One or two specks that cross the picture far faster than their size allows an aircraft; they get no box."""
        for _ in range(int(self.random.integers(1, 3))):
            views, _ = self.drawn[int(self.random.integers(len(self.drawn)))]
            length = float(self.random.uniform(*INSECT_PX))
            place = self.random.uniform(0, CROP_PX - 1, 2)
            scale = length / max(views[0].size_px)
            self._fly(image, views, place, insect_velocity(length, self.random), scale=scale, sigma=sigma)

    def _views(self) -> Views:
        if self.random.random() < self.mix.drawn_cutout or not self.cutouts:
            return self.drawn[int(self.random.integers(len(self.drawn)))]
        return _pick(self.cutouts, self.random)


def _scatter(image: Floats, place: Vector) -> float:
    """How much the newest frame varies about a place: one sigma, grey levels."""
    u, v = int(place[0]), int(place[1])
    near = image[max(v - TEXTURE_PX, 0) : v + TEXTURE_PX + 1, max(u - TEXTURE_PX, 0) : u + TEXTURE_PX + 1, 0]
    return float(near.std())


def _near(box: Box, x: float, y: float) -> bool:
    return abs(x - box.x_px) < APART_PX + box.width_px and abs(y - box.y_px) < APART_PX + box.height_px


def _by_class(items: Sequence[Item], labels: Sequence[int]) -> dict[int, list[Item]]:
    found: dict[int, list[Item]] = {}
    for item, label in zip(items, labels, strict=True):
        found.setdefault(label, []).append(item)
    return found


def _pick(by_class: dict[int, list[Item]], random: np.random.Generator) -> Item:
    """One of a class, each class as likely: a net that expects drones would call every speck a drone."""
    items = by_class[int(random.choice(sorted(by_class)))]
    return items[int(random.integers(len(items)))]
