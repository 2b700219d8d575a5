"""The scale of the pixels' noise, which outliers do not move, and the loss that does not listen to them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.adjustment.noise import CORE, SMALLEST_SIGMA_PX, mean_square_px, robust_cost, robust_weight


@given(length=st.floats(0.01, 1e4))
def test_the_weight_is_the_slope_of_the_cost(length: float) -> None:
    step = 1e-6 * length
    low, high = robust_cost(np.array([length - step, length + step]))
    assert (high - low) / (2 * step) == pytest.approx(2 * length * robust_weight(np.array([length]))[0], rel=1e-5)


def test_a_wild_residual_has_no_pull() -> None:
    pull = np.array([1.0, CORE, 10.0, 1000.0]) * robust_weight(np.array([1.0, CORE, 10.0, 1000.0]))
    assert pull[0] == 1.0
    assert pull[1] == CORE
    assert pull[2] < CORE
    assert pull[3] < 0.01


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
def test_the_scale_survives_outliers(share: float) -> None:
    rng = np.random.default_rng(4)
    residual = rng.normal(0, 0.7, (4000, 2))
    wrong = rng.random(4000) < share
    residual[wrong] = rng.uniform(-300, 300, (int(wrong.sum()), 2))
    # The first guess is a median among outliers: at 30 % 1.34 sigma, which lets the nearest of 1200 count a little.
    # Without any, cutting the tail beyond CORE takes 3 %. 4000 rows: 1 %.
    assert np.sqrt(mean_square_px(residual, np.ones(4000))) == pytest.approx(0.7, rel=0.05)


def test_a_detectors_own_sigma_is_divided_out() -> None:
    rng = np.random.default_rng(4)
    relative = rng.uniform(0.5, 3.0, 4000)
    residual = rng.normal(0, 0.4, (4000, 2)) * relative[:, None]
    assert np.sqrt(mean_square_px(residual, relative)) == pytest.approx(0.4, rel=0.03)


def test_no_noise_at_all_is_the_smallest_not_zero() -> None:
    assert mean_square_px(np.zeros((50, 2)), np.ones(50)) == SMALLEST_SIGMA_PX**2
