"""What a camera's pixels get wrong is learnt while they are used: their scatter, and what stays."""

import numpy as np
import pytest

from calib.tracking.pixel_errors import MOST_WHITE, Looks, PixelErrors

RATE_HZ = 30.0
CAMERAS = 4
SECONDS = 20.0


def learn(scatter_px: float, stays_px: float, claimed_px: float, seed: int, turn_px_s2: float = 0.0) -> PixelErrors:
    """One target in camera 1 for a while; innovations keep what four cameras leave of an error."""
    rng, errors = np.random.default_rng(seed), PixelErrors(CAMERAS)
    errors.add()
    kept = 1 - 3 / (2 * CAMERAS)
    for k in range(int(SECONDS * RATE_HZ)):
        t_s = k / RATE_HZ
        noise = rng.normal(0, scatter_px, (1, 2))
        error = noise + stays_px * np.array([[1.0, 0.0]]) * np.sqrt(2)
        pixels = np.array([[500 + 40 * t_s + turn_px_s2 * t_s**2 / 2, 300.0]]) + error
        looks = Looks(pixels, kept * error, np.full(1, claimed_px**2), np.zeros(1), np.full(1, CAMERAS))
        errors.learn(1, np.array([0]), t_s, looks)
    return errors


@pytest.mark.parametrize("seed", range(5))
def test_a_detector_that_says_what_is_true_is_left_alone(seed: int) -> None:
    """Of 300 rows, a fourth of them independent, the variance is told to a tenth: 1.3 is three sigma."""
    errors = learn(1.0, 0.0, 1.0, seed)
    assert errors.white[1] < 1.3
    assert errors.lasting_px[1] < 0.5  # squared, a sigma's fourth part: what ten seconds tell of a mean of one
    np.testing.assert_array_equal(errors.white[[0, 2, 3]], 1.0)


@pytest.mark.parametrize("seed", range(5))
def test_one_that_claims_half_of_its_scatter_is_given_four_times_the_variance(seed: int) -> None:
    errors = learn(1.0, 0.0, 0.5, seed)
    assert errors.white[1] == pytest.approx(4.0, rel=0.3)
    assert learn(0.5, 0.0, 1.0, seed).white[1] == 1.0, "and what is better than it says is not believed to be"
    assert 10 < learn(30.0, 0.0, 0.1, seed).white[1] <= MOST_WHITE


@pytest.mark.parametrize("seed", range(5))
def test_what_stays_is_told_from_scatter_and_counts_for_all_cameras_in_part(seed: int) -> None:
    errors = learn(1.0, 4.0, 1.0, seed)
    assert errors.lasting_px[1] == pytest.approx(4.0, rel=0.25)
    assert errors.white[1] < 1.3
    np.testing.assert_allclose(errors.lasting_px[[0, 2, 3]], errors.lasting_px[1] / 2)  # a fourth of the variance


def test_a_hard_turn_is_no_scatter() -> None:
    """4 g at 45 m, f = 1150: 1000 px/s2, and a row of four lasts a tenth of a second."""
    assert learn(0.2, 0.0, 0.2, 1, turn_px_s2=1000.0).white[1] < 1.3


def test_another_network_keeps_what_was_learnt_of_the_cameras_it_shares() -> None:
    errors = learn(1.0, 4.0, 0.5, 0)
    white, lasting = errors.white[1], errors.lasting_px[1]
    errors.exchange([-1, 0, 1])
    assert errors.white[2] == white
    assert errors.lasting_px[2] == lasting
    assert errors.white[0] == 1.0
    errors.keep(np.array([False]))
