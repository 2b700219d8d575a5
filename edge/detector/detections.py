"""What a detector found in one frame, as columns.

Pixel origin: the centre of the top-left pixel, as everywhere. Most detection models count from that pixel's corner
instead; each decoder says so and takes the half pixel off, once, where the boxes leave it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Picture
from edge.common.arrays import Array


@dataclass(frozen=True)
class Detections:
    """Objects in one frame. centre_px: `(N, 2)` u, v. size_px: `(N, 2)`. score: `(N,)`. sigma_px: `(N,)` one sigma of
    the centre per coordinate, NaN where unknown. classes: `(N, C)` scores by class."""

    centre_px: Array
    size_px: Array
    score: Array
    sigma_px: Array
    classes: Array

    def __len__(self) -> int:
        return len(self.score)

    def where(self, keep: NDArray[np.intp] | NDArray[np.bool_]) -> "Detections":
        """Those chosen by index or mask."""
        return Detections(
            self.centre_px[keep], self.size_px[keep], self.score[keep], self.sigma_px[keep], self.classes[keep]
        )


def nothing(classes: int) -> Detections:
    """No detection, of a model with so many classes."""
    return Detections(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros((0, classes)))


def together(parts: Sequence[Detections], classes: int) -> Detections:
    """All detections of several parts of one frame."""
    if not parts:
        return nothing(classes)
    return Detections(
        np.concatenate([part.centre_px for part in parts]),
        np.concatenate([part.size_px for part in parts]),
        np.concatenate([part.score for part in parts]),
        np.concatenate([part.sigma_px for part in parts]),
        np.concatenate([part.classes for part in parts]),
    )


class Detector(Protocol):
    """Finds objects in frames of one camera, one after the other."""

    class_names: tuple[str, ...]
    colour: bool
    """Whether it wants BGR frames rather than grey ones."""
    remembers: bool
    """Whether a frame's result depends on the frames before it, so that frames must be given one by one."""
    track_score: float
    """Mean score that a track of a real object keeps up and one of clutter does not."""

    def detect(self, frame: Picture, expected_px: Array) -> Detections:
        """The objects in a frame. expected_px: `(M, 2)` where tracks are expected; a detector may look there first."""

    def counters(self) -> dict[str, float]:
        """What it did so far, by name; every number only grows."""

    def close(self) -> None:
        """End its threads."""
