"""Rendered scenes as training material: whole made-up flights before moving trees and clouds, with exact truth.

The same renderer makes the demo's videos and the scenes the model card measures; seeds keep them apart: training uses
seeds below FIRST_TEST_SEED, every measurement seeds from there on.
"""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from calib.simulation.description import CameraSpec, ObjectSpec, Simulation, Weather
from calib.simulation.simulation import watch
from tools.render import CODEC
from tools.rendering.footage import Label, footage
from tools.train.footage import BACKGROUND_PX, PATCH_PX, Material
from tools.train.patches import CLASSES, Box, Floats, Grey, Patch

FIRST_TEST_SEED: Final = 1_000_000
SIZE_PX: Final = (640, 480)
FOCAL_PX: Final = 1000.0
DURATION_S: Final = 1.4
LAGS: Final = (0, 3, 6)  # frames at 30 Hz: 100 and 200 ms
EVERY: Final = 3  # frames between samples
SPEED_RANGE_PX_S: Final = (5.0, 250.0)
MARGIN_PX: Final = (PATCH_PX - BACKGROUND_PX) // 2
WANDER_PX: Final = 12.0  # a predicted track or a moving blob is not centred better than this
CODED: Final = 0.6  # of the scenes: most cameras send coded video
LEAST_VISIBLE: Final = 0.6  # of an object behind leaves; less is not to be learned
WIDTHS_M: Final = {"drone": 0.5, "bird": 0.9, "aeroplane": 12.0, "helicopter": 10.0}


def scene(seed: int, width_px: float, kind: str, size_px: tuple[int, int] = SIZE_PX) -> Simulation:
    """One camera, one object of about `width_px` amid its picture, weather and exposure of the seed's choice."""
    random = np.random.default_rng((seed, 7))
    width_m = WIDTHS_M[kind]
    distance_m = FOCAL_PX * width_m / width_px
    elevation = np.radians(random.uniform(3, 40))
    centre = np.array([0.0, np.cos(elevation), np.sin(elevation)]) * distance_m + [0, 0, 1.5]
    speed_m_s = np.exp(random.uniform(*np.log(SPEED_RANGE_PX_S))) * distance_m / FOCAL_PX
    step = random.normal(0, 1, (5, 3)) * [1, 0.2, 0.6]
    path = np.cumsum(step / np.linalg.norm(step, axis=1, keepdims=True), axis=0)
    waypoints = centre + (path - path.mean(axis=0)) * speed_m_s * DURATION_S / 4
    thing = ObjectSpec(
        kind=kind,  # type: ignore[arg-type]
        waypoints_enu=tuple((float(e), float(n), float(u)) for e, n, u in waypoints),
        step_s=DURATION_S / 4,
        width_m=width_m,
        height_m=width_m * random.uniform(0.25, 0.5),
    )
    camera = CameraSpec(
        id="camera",
        size_px=size_px,
        intrinsics=(FOCAL_PX, FOCAL_PX, size_px[0] / 2, size_px[1] / 2),
        centre_enu=(0.0, 0.0, 1.5),
        look_at_enu=(float(centre[0]), float(centre[1]), float(centre[2])),
        exposure_s=float(random.uniform(0.0005, 0.012)),
    )
    weather = Weather(
        clouds=float(random.uniform(0, 1)),
        foliage=float(random.uniform(0, 1)),
        sun=bool(random.random() < 0.5),
        sensor_noise=float(random.uniform(0.5, 4)),
    )
    return Simulation(seed=seed, duration_s=DURATION_S, object=(thing,), camera=(camera,), weather=weather)


def stacks(
    simulation: Simulation, through: Callable[[list[Grey]], list[Grey]] | None = None
) -> list[tuple[Grey, tuple[Label, ...]]]:
    """Stacks `(H, W, 3)` of a scene's only camera, EVERY frames apart, with the labels of their newest frame.

    through: what is done to the images before they are stacked, a codec for instance.
    """
    frames = list(footage(watch(simulation), 0))
    images = [np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), np.uint8) for frame in frames]
    images = through(images) if through else images
    numbers = [k for k in range(max(LAGS), len(frames)) if frames[k].number % EVERY == 0]
    return [(np.stack([images[k - lag] for lag in LAGS], axis=2), frames[k].labels) for k in numbers]


def through_codec(images: list[Grey]) -> list[Grey]:
    """The same images after being written and read as a video by the codec of `tools/render`."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "scene.mp4")
        writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*CODEC), 30.0, images[0].shape[1::-1])
        for image in images:
            writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
        writer.release()
        capture = cv2.VideoCapture(path)
        read = [np.asarray(cv2.cvtColor(capture.read()[1], cv2.COLOR_BGR2GRAY), np.uint8) for _ in images]
        capture.release()
    return read


def centred_crops(seed: int, width_px: float, kind: str, *, coded: bool, size_px: int) -> list[tuple[Grey, Floats]]:
    """Square crops of one scene, and where in each the object is `(2,)` px: WANDER_PX or less off the middle."""
    random = np.random.default_rng((seed, 9))
    found = []
    for stack, labels in stacks(scene(seed, width_px, kind), through_codec if coded else None):
        for label in labels:
            if label.visible >= LEAST_VISIBLE and _whole_in(label, stack):
                corner = np.array(label.centre_px) - size_px / 2 + random.uniform(-WANDER_PX, WANDER_PX, 2)
                low = np.clip(corner, 0, np.array(stack.shape[1::-1]) - size_px).astype(int)
                crop = stack[low[1] : low[1] + size_px, low[0] : low[0] + size_px]
                found.append((crop, np.asarray(np.array(label.centre_px) - low, np.float32)))
    return found


def _whole_in(label: Label, stack: Grey) -> bool:
    left, top, width, height = label.box_px
    return left >= 0 and top >= 0 and left + width < stack.shape[1] and top + height < stack.shape[0]


def render_material(count: int, random: np.random.Generator) -> Material:
    """Patches and backgrounds of `count` scenes, objects 2.5 to 40 px wide, of every class."""
    material = Material()
    for _ in range(count):
        kind = str(random.choice(CLASSES, p=[0.4, 0.2, 0.2, 0.2]))
        width_px = float(np.exp(random.uniform(np.log(2.5), np.log(40))))
        simulation = scene(int(random.integers(FIRST_TEST_SEED)), width_px, kind)
        for stack, labels in stacks(simulation, through_codec if random.random() < CODED else None):
            for _ in range(2):
                _cut(material, stack, labels, random)
    return material


def _cut(material: Material, stack: Grey, labels: tuple[Label, ...], random: np.random.Generator) -> None:
    """One patch of a rendered stack: about its object or, half the time, anywhere low in the picture."""
    height, width = stack.shape[:2]
    free = np.array([width - PATCH_PX, height - PATCH_PX])
    if labels and random.random() < 0.5:
        corner = np.array(labels[0].centre_px) - PATCH_PX / 2 + random.uniform(-40, 40, 2)
    else:
        corner = np.array([random.uniform(0, free[0]), random.uniform(0, free[1], 2).max()])
    x, y = np.clip(corner, 0, free).astype(int)
    patch = stack[y : y + PATCH_PX, x : x + PATCH_PX].copy()
    inside = [label for label in labels if _overlaps(label, x, y)]
    if not inside:
        material.backgrounds.append(patch[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX].copy())
    elif all(_whole(label, x, y) and label.visible >= LEAST_VISIBLE for label in inside):
        material.patches.append(Patch(patch, tuple(_box(label, x, y) for label in inside)))


def _overlaps(label: Label, x: int, y: int) -> bool:
    left, top, width, height = label.box_px
    return left < x + PATCH_PX and left + width > x and top < y + PATCH_PX and top + height > y


def _whole(label: Label, x: int, y: int) -> bool:
    return x <= label.centre_px[0] < x + PATCH_PX and y <= label.centre_px[1] < y + PATCH_PX


def _box(label: Label, x: int, y: int) -> Box:
    u, v = label.centre_px
    size = (max(label.box_px[2], 1.0), max(label.box_px[3], 1.0))
    return Box(u - x, v - y, *size, CLASSES.index(label.kind), exact=1.0)
