"""The banded normal equations against the same system written out densely."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.adjustment.normal import BLOCK_POINTS, Normal, factorise, local_covariance
from calib.geometry.spline import ORDER, Flight


def system(spans: int, seed: int, rows: int, border: int = 5) -> tuple[Normal, np.ndarray, np.ndarray]:
    """A random well-posed system: as Normal, and as the dense matrix and right-hand side it stands for."""
    rng = np.random.default_rng(seed)
    flight = Flight(np.array([0.0]), np.array([spans]), 1.0, np.array([0]))
    controls = flight.controls
    located = flight.locate(rng.uniform(0, spans, rows), np.zeros(rows, np.int64))
    by_point, by_camera = rng.normal(size=(rows, 2, 3)), rng.normal(size=(rows, 2, border))
    residual = rng.normal(size=(rows, 2))
    normal = Normal.zero(controls, border)
    normal.add_observations(located, by_point, by_camera, residual, slice(0, border))
    prior, gradient = np.diag(rng.uniform(0.5, 2.0, border)), rng.normal(size=border)
    normal.add_prior(slice(0, border), prior, gradient)
    for control in range(controls):
        normal.block[0, control] += np.eye(3)  # every control point is held, also one that no row touches

    J = np.zeros((2 * rows, 3 * controls + border))
    for n, (first, w) in enumerate(zip(located.first, located.weights(), strict=True)):
        for i in range(ORDER):
            J[2 * n : 2 * n + 2, 3 * (first + i) : 3 * (first + i) + 3] = w[i] * by_point[n]
        J[2 * n : 2 * n + 2, 3 * controls :] = by_camera[n]
    dense = J.T @ J
    dense[: 3 * controls, : 3 * controls] += np.eye(3 * controls)
    dense[3 * controls :, 3 * controls :] += prior
    right = -J.T @ residual.ravel()
    right[3 * controls :] -= gradient
    return normal, dense, right


@settings(max_examples=20)
@given(spans=st.integers(1, 40), seed=st.integers(0, 10**6), rows=st.integers(1, 120))
def test_solution_is_the_dense_one(spans: int, seed: int, rows: int) -> None:
    normal, dense, right = system(spans, seed, rows)
    step = factorise(normal).solve(normal)
    expected = np.linalg.solve(dense, right)
    # The condition number is below 1e6 by construction.
    assert np.concatenate([step.control.ravel(), step.camera]) == pytest.approx(expected, abs=1e-9)
    information = np.linalg.inv(factorise(normal).camera_covariance)
    assert step.camera_squared == pytest.approx(step.camera @ information @ step.camera, rel=1e-6)


@settings(max_examples=20)
@given(spans=st.integers(1, 40), seed=st.integers(0, 10**6))
def test_camera_covariance_has_the_flight_integrated_out(spans: int, seed: int) -> None:
    normal, dense, _ = system(spans, seed, 80)
    size = len(normal.right_camera)
    assert factorise(normal).camera_covariance == pytest.approx(np.linalg.inv(dense)[-size:, -size:], abs=1e-10)


def test_damping_multiplies_both_diagonals() -> None:
    normal, dense, right = system(7, 3, 60)
    size = len(normal.right_camera)
    damped = dense + 0.3 * np.diag(np.diag(dense))
    step = factorise(normal, 0.3).solve(normal)
    assert step.camera == pytest.approx(np.linalg.solve(damped, right)[-size:], abs=1e-10)


@pytest.mark.parametrize("spans", [1, 2, BLOCK_POINTS - 3, BLOCK_POINTS - 2, BLOCK_POINTS, 2 * BLOCK_POINTS + 1, 40])
def test_local_covariance_is_the_inverses_own_neighbourhood(spans: int) -> None:
    normal, dense, _ = system(spans, 5, 60)
    controls = len(normal.right_control)
    inverse = np.linalg.inv(dense[: 3 * controls, : 3 * controls])
    local = local_covariance(normal.block)
    assert local.shape == (controls - 3, 4, 3, 4, 3)
    for first in range(controls - 3):
        at = slice(3 * first, 3 * first + 12)
        assert local[first].reshape(12, 12) == pytest.approx(inverse[at, at], abs=1e-12)


def test_what_is_not_determined_is_an_error_not_a_number() -> None:
    normal, _, _ = system(5, 1, 30)
    normal.block[0, 3] -= 1e3 * np.eye(3)
    with pytest.raises(np.linalg.LinAlgError):
        factorise(normal)
