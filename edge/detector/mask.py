"""Regions of a camera's picture that its detector leaves out: a road, a flag, a neighbour's trees. Pure.

The hazard is the mask that is not the one that was meant: a corner typed wrongly blinds the camera where it should
see, and nothing in its tracks shows that. So a region that crosses itself, reaches out of the picture or leaves nothing
of it is refused by name, and what is left out is drawn into the preview. An object is left out by its centre: pixels
are never painted over, for the edge of a painted region would look like an object.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image, Picture
from edge.common.arrays import Array
from edge.detector.detections import Detections, Detector

LEAST_AREA_PX: Final = 1.0  # px²: what is smaller is a line or a point
LEAST_LEFT: Final = 0.01  # share of the picture that has to be looked at
EDGE_PX: Final = 0.5  # px by which corners may lie outside: pixels reach so far around their centres
MASKED: Final = 255  # of a raster's pixels
OUTLINE_BGR: Final = (80, 80, 255)  # of a region, where it is shown
DRAWN_BITS: Final = 4  # of a pixel's fraction, that the raster is drawn with


@dataclass(frozen=True)
class Region:
    """One polygon. corners_px: `(N, 2)` of u, v, in order around it."""

    name: str
    corners_px: Array


@dataclass(frozen=True)
class Mask:
    """Regions of pictures of a size (width, height). raster: `(H, W)`, MASKED where nothing is looked for."""

    size_px: tuple[int, int]
    regions: tuple[Region, ...]
    raster: Image

    @classmethod
    def of(cls, size_px: tuple[int, int], regions: Sequence[Region]) -> "Mask":
        """Raises ValueError for a region that is none, by its name, and where hardly anything is left."""
        for region in regions:
            if why := fault(region.corners_px, size_px):
                raise ValueError(f"{region.name} {why}")
        raster = np.zeros((size_px[1], size_px[0]), np.uint8)
        for region in regions:
            corners = np.round(region.corners_px * 2**DRAWN_BITS).astype(np.int32)
            cv2.fillPoly(raster, [corners], (MASKED,), shift=DRAWN_BITS)
        mask = cls(size_px, tuple(regions), raster)
        if mask.share > 1 - LEAST_LEFT:
            raise ValueError(f"all regions together leave {1 - mask.share:.2%} of the picture")
        return mask

    @property
    def share(self) -> float:
        """Of the picture, that is left out."""
        return cv2.countNonZero(self.raster) / self.raster.size

    def covers(self, places_px: Array) -> NDArray[np.bool_]:
        """Which of places `(N, 2)` or `(N, 3)` of u, v lie in a region; none that lies outside of the picture."""
        u, v = (np.rint(places_px[:, k]).astype(int) for k in (0, 1))
        inside = (u >= 0) & (v >= 0) & (u < self.size_px[0]) & (v < self.size_px[1])
        covered = np.zeros(len(places_px), dtype=bool)
        covered[inside] = self.raster[v[inside], u[inside]] == MASKED
        return covered


def fault(corners_px: Array, size_px: tuple[int, int]) -> str:
    """What is wrong with a polygon; empty if nothing is."""
    if len(corners_px) < 3:
        return f"has {len(corners_px)} corners, a region has three or more"
    for u, v in corners_px.tolist():
        if not (-EDGE_PX <= u <= size_px[0] - EDGE_PX and -EDGE_PX <= v <= size_px[1] - EDGE_PX):
            return f"has a corner at [{u:g}, {v:g}], outside of the picture of {size_px[0]} x {size_px[1]}"
    if crossing := _crossing(corners_px):
        return f"crosses itself: its side {crossing[0]} meets its side {crossing[1]}"
    if abs(_twice_area(corners_px)) / 2 < LEAST_AREA_PX:
        return "has no area: its corners lie on a line"
    return ""


def _crossing(corners_px: Array) -> tuple[int, int] | None:
    """Two sides, counted from 1, that cross; None if none do. Sides that only touch do not."""
    sides = list(pairwise([*corners_px.tolist(), corners_px[0].tolist()]))
    for k, (a, b) in enumerate(sides):
        for m in range(k + 1, len(sides)):
            c, d = sides[m]
            if _turn(a, b, c) * _turn(a, b, d) < 0 and _turn(c, d, a) * _turn(c, d, b) < 0:
                return k + 1, m + 1
    return None


def _turn(a: list[float], b: list[float], c: list[float]) -> float:
    return float(np.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])))


def _twice_area(corners_px: Array) -> float:
    u, v = corners_px.T
    return float(np.dot(u, np.roll(v, -1)) - np.dot(v, np.roll(u, -1)))


class Masked:
    """A detector whose finds in masked regions are left out, and counted."""

    def __init__(self, detector: Detector, mask: Mask) -> None:
        self._detector = detector
        self._mask = mask
        self._left_out = 0
        self.class_names = detector.class_names
        self.colour = detector.colour
        self.remembers = detector.remembers
        self.track_score = detector.track_score

    def detect(self, frame: Picture, expected_px: Array) -> Detections:
        """The objects in a frame whose centres lie in no region."""
        found = self._detector.detect(frame, expected_px)
        covered = self._mask.covers(found.centre_px)
        self._left_out += int(covered.sum())
        return found.where(np.flatnonzero(~covered))

    def counters(self) -> dict[str, float]:
        """The detector's, and how much was left out."""
        return {**self._detector.counters(), "detector_masked": float(self._left_out)}

    def close(self) -> None:
        """End the detector's threads."""
        self._detector.close()


def shaded(picture: Image, mask: Mask) -> Image:
    """A BGR picture `(H, W, 3)`, of any size, in which the masked regions are dark and outlined."""
    height, width = picture.shape[:2]
    covered: Any = cv2.resize(mask.raster, (width, height), interpolation=cv2.INTER_NEAREST) == MASKED
    shown = picture.copy()
    shown[covered] //= 2
    contours, _ = cv2.findContours(covered.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return cv2.drawContours(shown, contours, -1, OUTLINE_BGR, 1)  # type: ignore[no-any-return]
