"""A mask: what it leaves out, and what it refuses; twenty regions of each kind, of one seed."""

import logging
import re
from pathlib import Path

import numpy as np
import pytest

from edge.capture.frame import Picture
from edge.common.errors import ConfigError
from edge.config import DetectorConfig
from edge.detector.mask import Mask, Region
from edge.detector.mask_file import read_mask
from edge.detector.opening import open_detector
from tests.edge.footage import sky

SIZE = (320, 240)
SEED = 18

log = logging.getLogger(__name__)


def rng() -> np.random.Generator:
    log.info("seed %d", SEED)
    return np.random.default_rng(SEED)


def star(random: np.random.Generator, corners: int, least_px: float = 15) -> np.ndarray:
    """A polygon around a middle, with corners in order of their angle: it can't cross itself."""
    angles = (np.arange(corners) + random.uniform(0.1, 0.9, corners)) * 2 * np.pi / corners
    middle, radius = random.uniform([100, 80], [220, 160]), random.uniform(least_px, 70, corners)
    return middle + radius[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


def write(path: Path, *regions: np.ndarray, size: tuple[int, int] = SIZE, name: str = "road") -> Path:
    parts = [f'[[region]]\nname = "{name}"\ncorners_px = {one.tolist()}\n' for one in regions]
    path.write_text(f"size_px = [{size[0]}, {size[1]}]\n" + "".join(parts))
    return path


def inside(place: np.ndarray, corners: np.ndarray) -> bool:
    """Whether a place lies in a polygon: a ray to the right meets its sides an odd number of times."""
    crossings = 0
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if (a[1] > place[1]) != (b[1] > place[1]):
            crossings += bool(a[0] + (place[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) > place[0])
    return crossings % 2 == 1


def distance_px(place: np.ndarray, corners: np.ndarray) -> float:
    """From a place to a polygon's nearest side."""
    off = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = np.clip(np.dot(place - a, b - a) / np.dot(b - a, b - a), 0, 1)
        off.append(np.hypot(*(place - a - along * (b - a))))
    return min(off)


def test_it_covers_what_lies_inside_of_its_regions(tmp_path: Path) -> None:
    random = rng()
    for _ in range(20):
        corners = star(random, int(random.integers(3, 12)))
        mask = read_mask(write(tmp_path / "m.toml", corners), SIZE)
        places = random.uniform([-20, -20], [340, 260], (200, 2))
        clear = np.array([distance_px(place, corners) > 1.5 for place in places])  # pixels lie on neither side
        expected = np.array([inside(place, corners) for place in places])
        assert (mask.covers(places) == expected)[clear].all()


def test_a_region_that_crosses_itself_is_refused_by_name(tmp_path: Path) -> None:
    random = rng()
    for _ in range(20):
        corners = star(random, int(random.integers(4, 8)), least_px=65)  # bulges everywhere
        k = int(random.integers(0, len(corners) - 1))
        corners[[k, k + 1]] = corners[[k + 1, k]]  # two neighbours exchanged: a bow
        with pytest.raises(ConfigError, match=r"region 'road' crosses itself: its side \d+ meets its side \d+"):
            read_mask(write(tmp_path / "m.toml", corners), SIZE)


def test_a_region_outside_of_the_picture_is_refused_by_name(tmp_path: Path) -> None:
    random = rng()
    for _ in range(20):
        corners = star(random, 5)
        corners[int(random.integers(0, 5))] += random.choice([-1, 1], 2) * [400.0, 300.0]
        with pytest.raises(ConfigError, match=r"region 'barn' has a corner at \[.*\], outside of the picture of 320"):
            read_mask(write(tmp_path / "m.toml", corners, name="barn"), SIZE)


WHOLE = np.array([[-0.5, -0.5], [319.5, -0.5], [319.5, 239.5], [-0.5, 239.5]])
HALF = np.array([[0, 0], [160, 0], [160, 239], [0, 239]])


@pytest.mark.parametrize(
    ("regions", "size", "said"),
    [
        ([WHOLE], SIZE, "leave 0.00% of the picture"),
        ([HALF, HALF + np.array([159, 0])], SIZE, "leave 0.00% of the picture"),
        ([np.array([[10, 10], [50, 50], [90, 90]])], SIZE, "has no area"),
        ([HALF], (640, 480), "was drawn on pictures of 640 x 480, the camera's are 320 x 240"),
        ([HALF[:2]], SIZE, "corners_px"),
    ],
)
def test_what_is_no_mask_is_refused(
    tmp_path: Path, regions: list[np.ndarray], size: tuple[int, int], said: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        read_mask(write(tmp_path / "m.toml", *regions, size=size), SIZE)


def test_the_detector_finds_nothing_there_and_all_else(model: Path) -> None:
    random = rng()
    mask = Mask.of(SIZE, [Region("trees", np.array([[0.0, 120.0], [319.0, 120.0], [319.0, 239.0], [0.0, 239.0]]))])
    detector = open_detector(DetectorConfig(model=str(model), score_min=0.3), background=False, mask=mask)
    for k in range(12):
        dots = [(40.0 + 4 * k, 60.0), (60.0 + 4 * k, 180.0)]
        found = detector.detect(Picture(k * 33_333_333, sky(SIZE, dots, random), "file"), np.zeros((0, 3)))
    assert found.centre_px[:, 1] == pytest.approx([60.0], abs=1.0)
    assert detector.counters()["detector_masked"] > 0


def test_what_moves_in_it_takes_no_turn_and_does_not_hide_the_rest(model: Path) -> None:
    """A wood that moves all over: without a mask everything moves, and nothing is looked at."""
    size, random = (640, 480), rng()
    wood = np.array([[0.0, 200.0], [639.0, 200.0], [639.0, 479.0], [0.0, 479.0]])
    crops = {}
    for name, mask in (("masked", Mask.of(size, [Region("wood", wood)])), ("open", None)):
        config = DetectorConfig(model=str(model), mode="two_stage", scan_period_s=0)
        detector = open_detector(config, background=False, mask=mask)
        seen = 0
        for k in range(16):
            image = sky(size, [(100.0 + 6 * k, 100.0)], random)
            if k >= 8:  # a gust
                image[208:] = random.integers(0, 255, image[208:].shape, dtype=np.uint8)
            found = detector.detect(Picture(k * 33_333_333, image, "file"), np.zeros((0, 3)))
            seen += k >= 8 and bool(np.any(np.hypot(*(found.centre_px - (100.0 + 6 * k, 100.0)).T) < 3))
        crops[name] = seen
    assert crops["masked"] == 8
    assert crops["open"] < crops["masked"]
