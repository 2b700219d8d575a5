"""Rows that no camera saw are found by their sameness, and nothing that was seen is, however still it stood."""

import numpy as np
import pytest

from calib.solving.unseen import unseen

FOCAL_PX = 1000.0
HZ = 10.0


def flight(seed: int, *, seconds: float = 60.0, noise_px: float = 0.7, decimals: int = 6) -> np.ndarray:
    """Pixels (N, 2) of a drone that flies from place to place."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / HZ)
    knots = np.arange(0, seconds + 5, 4.0)
    path = np.column_stack([np.interp(t, knots, rng.uniform(200, high, len(knots))) for high in (1700, 900)])
    return np.round(path + rng.normal(0, noise_px, path.shape), decimals)


def found(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Constant and held rows."""
    got = unseen(np.arange(len(pixels)) / HZ, pixels, FOCAL_PX)
    return got.constant, got.held


def runs(seed: int, count: int, share: float) -> np.ndarray:
    rng, hit = np.random.default_rng(seed), np.zeros(count, bool)
    while hit.mean() < share:
        start = int(rng.integers(1, count))
        hit[start : start + int(rng.integers(3, 40))] = True
    return hit


@pytest.mark.parametrize("decimals", [0, 1, 6])
@pytest.mark.parametrize("value", [(0.0, 0.0), (-1.0, -1.0), (960.0, 540.0), (1919.0, 1079.0), (17.0, 300.0)])
@pytest.mark.parametrize("share", [0.03, 0.3, 0.6])
def test_a_constant_for_unseen_frames(value: tuple[float, float], share: float, decimals: int) -> None:
    pixels, hit = flight(3, decimals=decimals), runs(4, 600, share)
    pixels[hit] = value
    constant, held = found(pixels)
    assert np.array_equal(constant, hit)
    assert not held.any()


@pytest.mark.parametrize(("decimals", "least"), [(0, 0.85), (1, 0.95), (6, 0.98)])
def test_a_position_that_is_held(decimals: int, least: float) -> None:
    true, hit = flight(5, decimals=decimals), runs(6, 600, 0.3)
    pixels = true[np.maximum.accumulate(np.where(hit, 0, np.arange(600)))]
    wrong = np.linalg.norm(pixels - true, axis=1) > 12.0
    constant, held = found(pixels)
    assert np.mean((constant | held)[wrong]) > least
    # The row that a run begins with was seen; it goes where a run was entered by a jump and reads as a constant.
    assert np.sum((constant | held) & ~hit) <= 3


@pytest.mark.parametrize("decimals", [0, 1, 6])
@pytest.mark.parametrize("back", [False, True])
def test_a_picture_that_froze(decimals: int, back: bool) -> None:
    pixels = flight(7, decimals=decimals)
    frozen = slice(301, 450 if back else 600)
    pixels[frozen] = pixels[300]
    _, held = found(pixels)
    assert held[frozen].all()
    assert held.sum() == (149 if back else 299)


@pytest.mark.parametrize("decimals", [0, 1, 6])
@pytest.mark.parametrize("noise_px", [0.0, 0.2, 0.7])
def test_nothing_of_a_flight_with_stops_is_lost(noise_px: float, decimals: int) -> None:
    """It stands still for 20 s twice, goes on slowly, and lands at the end."""
    rng = np.random.default_rng(8)
    speed = np.concatenate([np.full(100, 6.0), np.zeros(200), np.full(60, 0.3), np.zeros(200), np.full(50, 5.0)])
    speed = np.concatenate([np.convolve(speed, np.ones(9) / 9, "same"), np.linspace(2, 0, 20), np.zeros(100)])
    path = np.column_stack([300 + np.cumsum(speed), 500 + 0.5 * np.cumsum(speed)])
    pixels = np.round(path + rng.normal(0, noise_px, path.shape), decimals)
    constant, held = found(pixels)
    assert not constant.any()
    assert not held.any()


def test_every_sixth_frame_said_twice_is_no_new_measurement() -> None:
    pixels = flight(9, noise_px=0.1)
    pixels[6::6] = pixels[5:-1:6]
    _, held = found(pixels)
    assert not held[np.arange(600) % 6 != 0].any()
    assert held[6::6].mean() > 0.7


def test_two_objects_and_a_camera_without_frames() -> None:
    one, two = flight(10), flight(11)
    t = np.repeat(np.arange(600) / HZ, 2)
    pixels = np.stack([one, two], axis=1).reshape(-1, 2)
    hit = np.repeat(runs(12, 600, 0.2), 2)
    pixels[hit] = (0.0, 0.0)
    assert np.array_equal(unseen(t, pixels, FOCAL_PX).constant, hit)
    assert not unseen(t[:0], pixels[:0], FOCAL_PX).rows.any()
    assert not unseen(t[:1], pixels[:1], FOCAL_PX).rows.any()
