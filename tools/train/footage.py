"""Labelled clips (video + CSV of boxes) into patches, plain backgrounds and cut-outs, decoded once.

Decoding is what costs, so a clip is read once and everything is taken from it in passing. Each positive patch is
kept at a scale of its own: area-averaging a 200 px object to 8 px in the inner loop would be dearer than the net.

The hazard is a label of another frame. Two thirds of the clips of the drone detection data set number their labels
from 1 although frames are counted from 0: followed to the letter, every box lies one frame of flight beside its object
and the first frame seems empty. Held against the measured centre of the object, the shift is exactly one frame.
"""

import csv
import json
from collections import deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from edge.common.errors import SourceError
from tools.train.patches import STACK_OFFSETS_S, Box, Cutout, Grey, Patch, lift

PATCH_PX: Final = 160  # a 96 px crop and room to shift and zoom it
EVERY: Final = 6  # frames between two samples of a clip: 0.2 s, after which an object has moved on
LARGEST_PX: Final = 45.0  # of an object's longer side; larger ones are scaled down to this at the least
SMALLEST_PX: Final = 2.0  # of an object's longer side; below it hardly anything is left
LIFTED_EXACT: Final = 0.15  # weight of a measured centre: its own error would be learned as the net's sigma
REAL_TELLING: Final = 0.4  # weight of the class of an object before the field it was filmed in
BACKGROUND_PX: Final = 104  # an 80 px crop zoomed out; larger ones at a third of the scale would hold the object
BACKGROUNDS: Final = (1, 3, 1, 3)  # taken a frame: half anywhere, half the lowest of three places, where the trees are
REDUCTIONS: Final = (1, 1, 2, 3, 4)  # of a background, one by chance: small clouds look like objects far away
TRIES: Final = 8  # places looked at for a background without an object
CLIP_CLASSES: Final = {"DRONE": 0, "BIRD": 1, "AIRPLANE": 2, "HELICOPTER": 3}


@dataclass(frozen=True)
class Loose:
    """A labelled object: its (left, top, width, height) px in each frame of a stack, newest first, and its class."""

    boxes: tuple[tuple[float, float, float, float] | None, ...]
    label: int


@dataclass
class Material:
    """What a training set is made of. A cut-out is three of one object, newest first, with its class."""

    patches: list[Patch] = field(default_factory=list)
    backgrounds: list[Grey] = field(default_factory=list)
    cutouts: list[tuple[tuple[Cutout, ...], int]] = field(default_factory=list)

    def add(self, other: "Material") -> None:
        """Take in what another has."""
        self.patches += other.patches
        self.backgrounds += other.backgrounds
        self.cutouts += other.cutouts


def read_split(folder: Path, part: str) -> list[str]:
    """Names of the clips of `part` ("train" or "test") of a data set with a `split.json`."""
    try:
        names = json.loads((folder / "split.json").read_text())[part]
    except (OSError, KeyError, ValueError) as error:
        raise SourceError(
            f"no usable split ({error})", where=str(folder), action="give the folder that holds split.json and videos/"
        ) from error
    return [str(name) for name in names]


def clip_class(clip: str) -> int:
    """The class of a clip, from its name."""
    return CLIP_CLASSES[clip.split("_")[1]]


def first_number(labelled: Collection[int], frames: int) -> int:
    """Whether a clip of so many frames numbers its labels from 0 or 1: those from 1 begin with it or end too late."""
    return int(bool(labelled) and (min(labelled) == 1 or max(labelled) >= frames))


def frame_count(video: Path) -> int:
    """How many frames a video says it has."""
    capture = cv2.VideoCapture(str(video))
    count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    capture.release()
    return count


def read_labels(path: Path) -> dict[int, tuple[float, float, float, float]]:
    """Frame number, as the table has it, to (left, top, width, height) px."""
    with path.open(newline="") as file:
        return {
            int(row["frame"]): (
                float(row["x_px"]),
                float(row["y_px"]),
                float(row["width_px"]),
                float(row["height_px"]),
            )
            for row in csv.DictReader(file)
        }


def stacks(video: Path) -> Iterator[tuple[int, list[Grey], list[int]]]:
    """Every frame of a video with the older ones of its stack: (number, [grey, ...] newest first, lags in frames)."""
    capture = cv2.VideoCapture(str(video))
    if not capture.isOpened():
        raise SourceError("the video does not open", where=str(video), action="check the file and its codec")
    fps = capture.get(cv2.CAP_PROP_FPS) or 30.0
    lags = [round(-offset * fps) for offset in STACK_OFFSETS_S]
    recent: deque[Grey] = deque(maxlen=max(lags) + 1)
    number = 0
    while True:
        ok, frame = capture.read()
        if not ok:
            break
        recent.append(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))
        yield number, [recent[max(len(recent) - 1 - lag, 0)] for lag in lags], lags
        number += 1
    capture.release()


def read_clip(folder: Path, clip: str, random: np.random.Generator) -> Material:
    """Everything training takes from one clip."""
    video = folder / "videos" / f"{clip}.mp4"
    labels = read_labels(folder / "labels" / f"{clip}.csv")
    first = first_number(labels, frame_count(video))
    labels = {number - first: box for number, box in labels.items()}
    material = Material()
    phase = int(random.integers(EVERY))
    for number, stack, lags in stacks(video):
        if number % EVERY == phase and number in labels:
            boxes = tuple(labels.get(number - lag) for lag in lags)
            take(material, stack, [Loose(boxes, clip_class(clip))], random)
    return material


def take(material: Material, stack: list[Grey], objects: list[Loose], random: np.random.Generator) -> None:
    """Add to `material` what one labelled stack holds: a patch and a cut-out per object, and some background."""
    tight: list[Box | None] = []
    for thing in objects:
        cutouts = tuple(lift(grey, box) if box else None for grey, box in zip(stack, thing.boxes, strict=True))
        found = tuple(cutout for cutout in cutouts if cutout is not None)
        if len(found) == len(cutouts):
            material.cutouts.append((found, thing.label))
        if thing.boxes[0] is not None:
            tight.append(tighten(thing.boxes[0], cutouts[0], stack[0], thing.label))
    boxes = [box for box in tight if box is not None]
    for box in boxes:
        others = [other for other in boxes if other is not box]
        material.patches.append(_patch(stack, box, others, random))
    for lowest_of in BACKGROUNDS:
        loose = [thing.boxes[0] for thing in objects if thing.boxes[0] is not None]
        background = _background(stack, loose, lowest_of, random)
        if background is not None:
            material.backgrounds.append(background)


def tighten(loose: tuple[float, float, float, float], cutout: Cutout | None, frame: Grey, label: int) -> Box | None:
    """The measured box if there is one; the loose one before a busy background; None where the label shows nothing."""
    left, top, width, height = loose
    x, y = left + width / 2, top + height / 2
    if cutout is None:
        x0, y0 = int(max(left, 0)), int(max(top, 0))
        window = frame[y0 : y0 + int(height) + 1, x0 : x0 + int(width) + 1]
        if window.size == 0 or np.ptp(cv2.GaussianBlur(window, (3, 3), 0)) < 12:
            return None  # nothing to be seen there: a label that jumped
        return Box(x - 0.5, y - 0.5, width / 2, height / 2, label, exact=0.0, telling=REAL_TELLING)
    return Box(*cutout.frame_px, *cutout.size_px, label, exact=LIFTED_EXACT, telling=REAL_TELLING)


def _patch(stack: list[Grey], box: Box, others: list[Box], random: np.random.Generator) -> Patch:
    """A PATCH_PX patch round a box, at a random scale that leaves the object between SMALLEST and LARGEST.

    The object as measured, not as labelled: some labels are three times as wide as what they hold.
    """
    longest_px = max(box.width_px, box.height_px)
    smallest, largest = min(SMALLEST_PX / longest_px, 1.0), min(LARGEST_PX / longest_px, 1.0)
    scale = float(np.exp(random.uniform(np.log(smallest), np.log(largest)))) if random.random() < 0.75 else largest
    span = min(round(PATCH_PX / scale), stack[0].shape[0])
    offset = random.uniform(-0.2, 0.2, 2) * span
    corner = [
        int(np.clip(c + o - span / 2, 0, n - span))
        for c, o, n in zip((box.x_px, box.y_px), offset, stack[0].shape[::-1], strict=True)
    ]
    windows = [grey[corner[1] : corner[1] + span, corner[0] : corner[0] + span] for grey in stack]
    size = min(round(span * scale), PATCH_PX)
    small = [cv2.resize(window, (size, size), interpolation=cv2.INTER_AREA) for window in windows]
    placed = tuple(_moved(each, corner, size / span) for each in [box, *others])
    inside = tuple(each for each in placed if 0 <= each.x_px < size and 0 <= each.y_px < size)
    return Patch(np.stack(small, axis=2), inside)


def _moved(box: Box, corner: list[int], scale: float) -> Box:
    """A box in a window that begins at `corner` and is scaled about its corner, not its first pixel's centre."""
    return Box(
        (box.x_px - corner[0] + 0.5) * scale - 0.5,
        (box.y_px - corner[1] + 0.5) * scale - 0.5,
        max(box.width_px * scale, 1.0),
        max(box.height_px * scale, 1.0),
        box.label,
        box.exact,
        box.telling,
    )


def _background(
    stack: list[Grey], loose: list[tuple[float, float, float, float]], lowest_of: int, random: np.random.Generator
) -> Grey | None:
    """A patch without a labelled object, at full scale or reduced; the lowest of so many places."""
    height, width = stack[0].shape
    span = min(int(random.choice(REDUCTIONS)) * BACKGROUND_PX, height - 1, width - 1)
    size = (BACKGROUND_PX, BACKGROUND_PX)
    for _ in range(TRIES):
        x = int(random.integers(0, width - span))
        y = int(max(random.integers(0, height - span, lowest_of)))
        if all(_apart(x, y, span, box) for box in loose):
            part = np.s_[y : y + span, x : x + span]
            return np.stack([cv2.resize(g[part], size, interpolation=cv2.INTER_AREA) for g in stack], axis=2)
    return None


def _apart(x: int, y: int, span: int, box: tuple[float, float, float, float]) -> bool:
    """Whether a square window keeps half a box's size away from the box."""
    left, top, width, height = box
    apart_x = x > left + 1.5 * width or x + span < left - 0.5 * width
    return apart_x or y > top + 1.5 * height or y + span < top - 0.5 * height
