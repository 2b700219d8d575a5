"""A camera's footage of a scene, frame by frame, each with its labels.

Frame k shows the scene at the stamp of frame k on the camera's own clock; an object appears where the row that shows it
was exposed, smeared by its motion while the shutter was open. Nothing is drawn here that `simulate` does not know.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.network import Camera
from calib.simulation import description
from calib.simulation.camera import TrueCamera, TrueSighting
from calib.simulation.flight import ObjectFlight
from calib.simulation.simulation import Watched
from edge.common.arrays import Array
from tools.rendering.backdrop import Backdrop, Float32, Image, backdrop
from tools.rendering.silhouette import FLAP_PHASES, Drawn, draw, shape, steps_for

FLAP_HZ = 5.0  # of a middling bird
DARK_BGR = np.array([46.0, 44.0, 42.0])
HAZE_M = 1500.0  # distance at which an object has lost 63 % of its contrast
LEAN_DEG_PER_M_S = 1.0  # a multirotor leans into its motion
SHORTEST_EXPOSURE_S = 1e-6  # so that a speed can be taken from it


@dataclass(frozen=True)
class Label:
    """Where an object truly is in a frame.

    centre_px: u, v to a fraction of a pixel, at the middle of the exposure of the row that shows it. box_px: left, top,
    width, height, motion blur included. visible: the share that no tree covers.
    """

    name: str
    kind: str
    centre_px: tuple[float, float]
    box_px: tuple[float, float, float, float]
    visible: float


@dataclass(frozen=True)
class Frame:
    """One frame: its number, stamp in ns since the scene's start, image (H, W, 3) uint8 BGR, and labels."""

    number: int
    stamp_ns: int
    image: Image
    labels: tuple[Label, ...]


def footage(watched: Watched, number: int) -> Iterator[Frame]:
    """All frames of camera `number` of a watched scene. The same scene gives the same frames."""
    camera, stamps = watched.cameras[number], watched.stamps_ns[number]
    rng = np.random.default_rng((watched.simulation.seed, 100, number))
    behind = backdrop(_standing(camera), watched.simulation.weather, rng)
    looks = [_look(camera, path, at) for path, at in zip(watched.flights, watched.sightings[number], strict=True)]
    for k, t_s in enumerate(camera.site_time_s(stamps).tolist()):
        image = behind.behind(t_s)
        labels = [_place(image, look, k) for look in looks if np.isfinite(look.width_px[k])]
        matte = behind.cover(image, t_s)
        labels = [_with_cover(label, behind, matte) for label in labels]
        yield Frame(k, int(stamps[k]), behind.grain(image, rng), tuple(labels))


@dataclass(frozen=True)
class Look:
    """How an object looks to a camera in each of its F frames; NaN where it does not.

    centre_px: (F, 2). motion_px: (F, 2) while the shutter is open. width_px, contrast: (F,). turned: (F, 2, 2) what the
    outline is turned and sheared by. phase: (F,) of the wings.
    """

    object: description.ObjectSpec
    centre_px: Array
    motion_px: Array
    width_px: Array
    contrast: Array
    turned: Array
    phase: NDArray[np.int64]


def _standing(camera: TrueCamera) -> Camera:
    return Camera(camera.description.id, camera.lens, camera.R_cam_enu[0], camera.centre_enu[0])


def _look(camera: TrueCamera, path: ObjectFlight, sighting: TrueSighting) -> Look:
    thing, t_s = path.object, sighting.t_s
    half = max(camera.description.exposure_s, SHORTEST_EXPOSURE_S) / 2
    before, after = (camera.project(path.position_enu(t_s + side), t_s + side)[0] for side in (-half, half))
    motion = np.nan_to_num(after - before)
    phase = np.floor(t_s * FLAP_HZ * FLAP_PHASES).astype(np.int64) % FLAP_PHASES
    return Look(
        object=thing,
        centre_px=sighting.pixels,
        motion_px=motion,
        width_px=camera.lens.intrinsics[0] * thing.width_m / sighting.depth_m,
        contrast=np.exp(-sighting.depth_m / HAZE_M),
        turned=_turned(camera, path, t_s, motion / (2 * half)),
        phase=phase if thing.kind == "bird" else np.zeros_like(phase),
    )


def _turned(camera: TrueCamera, path: ObjectFlight, t_s: Array, speed_px_s: Array) -> Array:
    """(F, 2, 2): a multirotor leans into its motion, others face it, and the rolling shutter shears what moves."""
    sideways = np.nan_to_num(path.velocity_enu(t_s)) @ camera.R_cam_enu[0, 0]
    lean = np.radians(np.clip(LEAN_DEG_PER_M_S * sideways, -20, 20)) * (path.object.kind == "drone")
    facing = np.where((sideways < 0) & (path.object.kind in {"aeroplane", "helicopter"}), -1.0, 1.0)
    later = camera.description.readout_s / camera.lens.size_px[1]  # s a row
    turn, shear = np.zeros((len(t_s), 2, 2)), np.tile(np.eye(2), (len(t_s), 1, 1))
    turn[:, 0, 0], turn[:, 1, 1] = np.cos(lean) * facing, np.cos(lean)
    turn[:, 1, 0], turn[:, 0, 1] = np.sin(lean) * facing, -np.sin(lean)
    shear[:, :, 1] += speed_px_s * later
    return np.asarray(shear @ turn)


def _place(image: Image, look: Look, k: int) -> Label:
    """Draw one object into frame k, in place; its label without regard to trees."""
    thing, motion, turned, width_px = look.object, look.motion_px[k], look.turned[k], float(look.width_px[k])
    steps = steps_for(float(np.linalg.norm(motion)))
    centres = look.centre_px[k] + np.linspace(-0.5, 0.5, 2 * steps + 1)[1::2, None] * motion
    outline = shape(thing.kind, thing.height_m / thing.width_m, int(look.phase[k]))
    _blend(image, draw(outline, width_px, turned, centres), float(look.contrast[k]))
    corners = outline.corners @ turned.T * width_px
    low, high = corners.min(axis=0) + centres.min(axis=0), corners.max(axis=0) + centres.max(axis=0)
    box = (float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1]))
    return Label(thing.name, thing.kind, (float(look.centre_px[k, 0]), float(look.centre_px[k, 1])), box, 1.0)


def _blend(image: Image, drawn: Drawn, contrast: float) -> None:
    """Darken the image behind a matte, in place; what lies outside the image is cut off."""
    height, width = image.shape[:2]
    h, w = drawn.matte.shape
    left, top, right, bottom = max(drawn.x, 0), max(drawn.y, 0), min(drawn.x + w, width), min(drawn.y + h, height)
    if right <= left or bottom <= top:
        return
    matte = drawn.matte[top - drawn.y : bottom - drawn.y, left - drawn.x : right - drawn.x, None] * contrast
    part = image[top:bottom, left:right]
    part[:] = np.round(part * (1 - matte) + DARK_BGR * matte).astype(np.uint8)


def _with_cover(label: Label, behind: Backdrop, matte: Float32 | None) -> Label:
    """The label with the share of its box that trees leave free."""
    if matte is None or behind.trees is None:
        return label
    left, top, width, height = label.box_px
    rows = slice(max(0, int(top) - behind.trees.top), max(0, int(top + height) + 1 - behind.trees.top))
    part = matte[rows, max(0, int(left)) : max(0, int(left + width) + 1)]
    # What lies above the trees' first row is free.
    free = 1.0 - float(part.sum()) / max(1.0, (int(height) + 1) * (int(width) + 1)) if part.size else 1.0
    return Label(label.name, label.kind, label.centre_px, label.box_px, max(0.0, free))
