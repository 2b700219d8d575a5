"""A bump is noticed and measured; clouds, noise, an even sky and an object that crosses are not taken for one."""

import cv2
import numpy as np
import pytest

from edge.capture.frame import Picture
from edge.pictures.view import ViewWatch

SIZE = (960, 540)
STEP_NS = 500_000_000


def landscape(seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = cv2.resize(rng.normal(0, 40, (60, 100)), (1160, 740), interpolation=cv2.INTER_CUBIC)
    return np.clip(130 + coarse + rng.normal(0, 10, coarse.shape), 0, 255)


def look(scene: np.ndarray, du: float, dv: float, k: int, noise: float = 2.0) -> Picture:
    moved = cv2.warpAffine(scene, np.array([[1, 0, du - 100], [0, 1, dv - 100.0]]), SIZE, flags=cv2.INTER_LINEAR)
    image = np.clip(moved + np.random.default_rng(k).normal(0, noise, moved.shape), 0, 255).astype(np.uint8)
    return Picture(k * STEP_NS, image, "file")


@pytest.mark.parametrize(("du", "dv"), [(6.0, 0.0), (-20.0, 9.0), (3.0, 40.0)])
def test_bump_is_measured(du: float, dv: float) -> None:
    scene, watch = landscape(), ViewWatch()
    shifts = [watch.update(look(scene, *((du, dv) if k >= 5 else (0, 0)), k)) for k in range(10)]
    assert [k for k, shift in enumerate(shifts) if shift] == [5]
    assert (shifts[5].du_px, shifts[5].dv_px) == pytest.approx((du, dv), abs=0.5)
    assert watch.shifts == 1
    assert not watch.moves


def test_drifting_clouds_noise_and_an_even_sky_are_no_bump() -> None:
    scene, drifting, even = landscape(), ViewWatch(), ViewWatch()
    for k in range(20):
        assert drifting.update(look(scene, 0.4 * k, 0.0, k)) is None
        assert even.update(look(np.full_like(scene, 180.0), 0.0, 0.0, k)) is None


def test_moving_camera_is_told_from_a_bump() -> None:
    scene, watch = landscape(), ViewWatch()
    for k in range(8):
        watch.update(look(scene, 8.0 * k, 0.0, k))
    assert watch.moves


def test_another_segment_is_compared_only_after_its_first_look() -> None:
    scene, watch = landscape(), ViewWatch()
    for k in range(20):
        watch.update(look(scene, 0.0, 0.0, k))
    assert watch.update(Picture(20 * STEP_NS + 1, look(scene, 0, 0, 20).image, "file", segment=1)) is None


def open_sky(rng: np.random.Generator, treeline: int) -> np.ndarray:
    """A sky with a gradient, darker corners and a sensor's fixed pattern, and trees along its lower edge."""
    v, u = np.mgrid[0:740, 0:1160].astype(np.float64)
    sky = 215 - 30 * v / 740 - 25 * (((u - 580) / 580) ** 2 + ((v - 370) / 370) ** 2) / 2
    trees = cv2.resize(rng.normal(70, 25, (200, 300)), (1160, 740), interpolation=cv2.INTER_CUBIC)
    edge = 100 + SIZE[1] - treeline
    return np.where(v > edge, trees, sky) if treeline else sky


@pytest.mark.parametrize("seed", range(20))
def test_one_object_on_open_sky_is_no_move_and_a_bump_there_is_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    width, treeline = int(rng.integers(5, 60)), int(rng.choice([0, 20, 45, 150]))
    scene, pattern = open_sky(rng, treeline), rng.normal(0, 0.7, (SIZE[1], SIZE[0]))
    step, place = rng.uniform(-40, 40, 2), np.array([rng.uniform(200, 700), rng.uniform(100, 350)])
    watch = ViewWatch()
    for k in range(21):
        bumped = k == 20
        image = look(scene, 12.0 * bumped, -7.0 * bumped, k, noise=1.5).image + pattern
        u, v = place + step * min(k, 19 - k)
        if not bumped:
            cv2.circle(image, (round(u), round(v)), width // 2, 60.0, -1)
        shift = watch.update(Picture(k * STEP_NS, np.clip(image, 0, 255).astype(np.uint8), "file"))
        if not bumped:
            assert shift is None, f"seed {seed}, look {k}: {shift}, step {step}, treeline {treeline}"
    if treeline == 150:
        assert shift is not None, f"seed {seed}"
