"""Held against the truth: what counts as beyond, the nearest of several objects, another origin's frame."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from calib.geodesy import ecef_to_enu, enu_to_ecef
from tools.doubles.hazards.verdict import BEYOND, TOLERATED, in_frame, scored

ROWS = 20_000


def drawn(scale: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, covariances and truth of errors `scale` times as large as stated, long in one direction."""
    rng = np.random.default_rng(seed)
    root = np.diag([0.1, 0.2, 2.0])
    truth = rng.uniform(-50, 50, (ROWS, 3))
    return truth + scale * rng.normal(0, 1, (ROWS, 3)) @ root, np.tile(root @ root, (ROWS, 1, 1)), truth


def test_beyond_is_what_a_normal_error_is_at_four_sigmas() -> None:
    assert chi2.sf(BEYOND, 3) == pytest.approx(2 * norm.sf(4.0))


def test_a_true_sigma_has_a_nees_of_one_and_nothing_beyond() -> None:
    points, covariance, truth = drawn(1.0)
    got = scored(points, covariance, [truth])
    assert got.nees == pytest.approx(1.0, abs=0.03)  # 3 standard deviations of 60 000 squares
    assert got.beyond < 5e-4
    assert got.rmse_m == pytest.approx(got.sigma_m, rel=0.03)
    assert not got.confidently_wrong


def test_a_sigma_of_a_third_of_the_truth_is_confidently_wrong() -> None:
    points, covariance, truth = drawn(3.0)
    got = scored(points, covariance, [truth])
    assert got.nees == pytest.approx(9.0, rel=0.05)
    assert got.beyond == pytest.approx(chi2.sf(BEYOND / 9, 3), abs=0.02)
    assert got.confidently_wrong


def test_an_error_in_the_direction_that_is_known_counts_though_it_is_short() -> None:
    points, covariance, truth = drawn(0.0)
    got = scored(points + np.array([1.0, 0.0, 0.0]), covariance, [truth])
    assert got.beyond == 1.0
    assert got.beyond_length == 0.0


def test_of_several_objects_the_nearest_counts_and_none_that_does_not_fly() -> None:
    points, covariance, truth = drawn(1.0)
    half = np.arange(ROWS) < ROWS // 2
    first, second = np.where(half[:, None], truth, np.nan), np.where(half[:, None], truth + 30.0, truth)
    assert scored(points, covariance, [first, second]).nees == pytest.approx(1.0, abs=0.03)
    alone = scored(points, covariance, [first])
    assert alone.beyond == pytest.approx(0.5, abs=TOLERATED)
    assert alone.confidently_wrong


def test_a_frame_of_another_origin_is_turned_with_its_vectors() -> None:
    here, there = (47.0, 8.0, 500.0), (47.3, 8.4, 100.0)
    points = np.random.default_rng(1).uniform(-100, 100, (5, 3))
    moved, turn = in_frame(points, there, here)
    assert moved == pytest.approx(ecef_to_enu(enu_to_ecef(points, there), here), abs=1e-6)
    assert (moved[1] - moved[0]) == pytest.approx(turn @ (points[1] - points[0]), abs=1e-6)
