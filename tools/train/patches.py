"""What training reads: stacks of three grey frames with the boxes in them, and cut-outs of objects on plain sky.

Labels of real footage are loose (1.5 to 3 times the object) and now and then beside the object. A net trained on
them localises no better than they do. Where the sky around a box is plain, the object is therefore measured against
it: its silhouette gives a tight box, its centroid a centre good to a fraction of a pixel, and its matte a cut-out
that can be set on any other background at a place known exactly.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]
Floats = NDArray[np.float32]

STACK_OFFSETS_S: Final = (0.0, -0.1, -0.2)  # what the channels of a stack are, relative to the newest frame
CLASSES: Final = ("drone", "bird", "aeroplane", "helicopter")
UNKNOWN_CLASS: Final = -1

MAX_SKY_SIGMA: Final = 5.0  # grey levels; more than this round a box is cloud edge or foliage, not plain sky
MIN_CONTRAST_SIGMAS: Final = 5.0  # an object fainter than this cannot be told from the sky's own grain
MATTE_FULL_SHARE: Final = 0.35  # of the peak contrast: from there on a pixel is all object
EXTENT_QUANTILE: Final = (
    0.02  # of the silhouette left outside either side of a tight box: one stray pixel is not a wing
)
FLYER_MARGIN: Final = 1.5  # times its size: the box in which a thing is measured against the sky
FLYER_LEAST_PX: Final = 8.0  # what is smaller is measured as if it were so large
FLYER_MOVED: Final = 0.4  # of its contrast: the least that has changed where it is


@dataclass(frozen=True)
class Box:
    """An object in a patch: centre and size in pixels, class index or UNKNOWN_CLASS.

    `exact` 0..1 is the weight of its centre and size: 0 says where an object is, and must teach nothing finer.
    `telling` 0..1 is the weight of its class: a net shown each class before its own field learns the fields.
    """

    x_px: float
    y_px: float
    width_px: float
    height_px: float
    label: int
    exact: float
    telling: float = 1.0


@dataclass(frozen=True)
class Patch:
    """A `(H, W, 3)` uint8 stack and the objects in its newest frame."""

    stack: Grey
    boxes: tuple[Box, ...]


@dataclass(frozen=True)
class Cutout:
    """An object lifted off the sky: `matte` `(H, W)` in 0..1 and `paint` `(H, W)`, grey times matte.

    `centre_px` is its centroid in the matte, `frame_px` the same point in the frame it was lifted from.
    """

    matte: Floats
    paint: Floats
    centre_px: tuple[float, float]
    size_px: tuple[float, float]
    frame_px: tuple[float, float]


def lift(frame: Grey, box_px: tuple[float, float, float, float]) -> Cutout | None:
    """The object in or near a loose box (left, top, width, height) of a grey frame; None if the sky is not plain there.

    The sky is the plane through the window's rim; what differs from it by more than the rim's own scatter is object.
    """
    left, top, width, height = box_px
    margin = 4 + 0.25 * max(width, height)
    x0, y0 = int(max(left - margin, 0)), int(max(top - margin, 0))
    x1, y1 = int(min(left + width + margin, frame.shape[1])), int(min(top + height + margin, frame.shape[0]))
    if x1 - x0 < 12 or y1 - y0 < 12:
        return None
    window = frame[y0:y1, x0:x1].astype(np.float32)
    sky, sigma = _sky_plane(window)
    if sigma > MAX_SKY_SIGMA:
        return None
    matte = _matte(window - sky, sigma)
    if matte is None:
        return None
    cutout = _measured(matte, window, sky, (x0, y0))
    # Labels are loose, so what is larger than its label is a cloud.
    return cutout if cutout.size_px[0] <= 1.1 * width and cutout.size_px[1] <= 1.1 * height else None


def flies(stack: Grey, spot: tuple[float, float], size_px: float) -> bool:
    """Whether a thing about so large stands out from plain sky there and was not there in the oldest frame."""
    side = FLYER_MARGIN * max(size_px, FLYER_LEAST_PX)
    newest = np.ascontiguousarray(stack[:, :, 0])
    cutout = lift(newest, (spot[0] - side / 2, spot[1] - side / 2, side, side))
    if cutout is None:
        return False
    rows, cols = cutout.matte.shape
    left = round(cutout.frame_px[0] - cutout.centre_px[0])
    top = round(cutout.frame_px[1] - cutout.centre_px[1])
    part = np.s_[top : top + rows, left : left + cols]
    now, before = newest[part].astype(np.float32), stack[part][:, :, -1].astype(np.float32)
    around = np.median(newest[max(top - 3, 0) : top + rows + 3, max(left - 3, 0) : left + cols + 3])
    change, contrast = np.abs(now - before) * cutout.matte, np.abs(now - around) * cutout.matte
    return bool(change.sum() > FLYER_MOVED * contrast.sum())


def _sky_plane(window: Floats) -> tuple[Floats, float]:
    """The plane through a window's 3 px rim, robustly (two passes), and the rim's scatter about it."""
    height, width = window.shape
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    rim = np.ones(window.shape, bool)
    rim[3:-3, 3:-3] = False
    design = np.stack([np.ones(rim.sum(), np.float32), u[rim] / width, v[rim] / height], axis=1)
    values = window[rim]
    use = np.ones(len(values), bool)
    for _ in range(2):
        plane = np.linalg.lstsq(design[use], values[use], rcond=None)[0]
        off = np.abs(values - design @ plane)
        use = off <= 3 * np.median(off) + 1
    sigma = float(1.4826 * np.median(off)) + 0.5
    spread = float(np.mean(~use))
    return plane[0] + plane[1] * u / width + plane[2] * v / height, sigma if spread < 0.2 else np.inf


def _matte(contrast: Floats, sigma: float) -> Floats | None:
    """How much of each pixel is object, 0..1: the strongest connected blob and what lies within 2 px of it."""
    strength = np.abs(contrast)
    peak = float(cv2.GaussianBlur(strength, (3, 3), 0).max())
    if peak < MIN_CONTRAST_SIGMAS * sigma:
        return None
    floor = 2 * sigma + 1
    full = max(floor + 3, MATTE_FULL_SHARE * peak)
    matte: Floats = np.clip((strength - floor) / (full - floor), 0, 1).astype(np.float32)
    solid = cv2.dilate((matte > 0.3).astype(np.uint8), np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(solid)
    if count < 2:
        return None
    mass = np.bincount(labels.ravel(), weights=(strength * matte).ravel(), minlength=count)
    mass[0] = 0
    near = cv2.dilate((labels == int(mass.argmax())).astype(np.uint8), np.ones((5, 5), np.uint8))
    matte[near == 0] = 0
    edge = np.concatenate([matte[0], matte[-1], matte[:, 0], matte[:, -1]])
    return None if edge.max() > 0.5 else matte


def _measured(matte: Floats, window: Floats, sky: Floats, corner: tuple[int, int]) -> Cutout:
    """The cut-out of a matte, trimmed to its support, with its centroid and its extents."""
    rows, cols = np.flatnonzero(matte.max(axis=1)), np.flatnonzero(matte.max(axis=0))
    part = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    matte, window, sky = matte[part], window[part], sky[part]
    total = float(matte.sum())
    x = float((matte.sum(axis=0) * np.arange(matte.shape[1])).sum() / total)
    y = float((matte.sum(axis=1) * np.arange(matte.shape[0])).sum() / total)
    size = (extent(matte.sum(axis=0)), extent(matte.sum(axis=1)))
    # Premultiplied: matte * colour, where colour = sky + (window - sky) / matte.
    paint = matte * sky + (window - sky) * (matte > 0)
    return Cutout(matte, paint, (x, y), size, (x + corner[0] + cols[0], y + corner[1] + rows[0]))


def extent(profile: Floats) -> float:
    """The width of a silhouette from its marginal profile, in px: all but EXTENT_QUANTILE on either side."""
    cumulative = np.concatenate([[0], np.cumsum(profile)]) / profile.sum()
    edges = np.interp([EXTENT_QUANTILE, 1 - EXTENT_QUANTILE], cumulative, np.arange(len(cumulative)))
    return float(max(edges[1] - edges[0], 1.0))
