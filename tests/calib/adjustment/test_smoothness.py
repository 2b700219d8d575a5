"""The flight's prior: blind to every linear map of the whole, and its curvature as well."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calib.adjustment.flight import FlightEstimate, jerk
from calib.adjustment.normal import Normal
from calib.adjustment.smoothness import Smoothness, borne_by_two
from calib.errors import CalibrationError
from calib.geometry.rotation import rotation
from calib.geometry.spline import ORDER, Flight
from calib.simulation.simulation import simulate
from calib.solving.solve import solve
from edge.common.arrays import Array
from tests.calib.flights import site

WEIGHT = 3.0


def flown(seed: int, spans: tuple[int, ...] = (9,)) -> FlightEstimate:
    """A flight like no pilot's: control points at random. In stretches of so many spans."""
    starts = np.concatenate([[0.0], np.cumsum(spans)[:-1] + 10.0])
    flight = Flight(starts, np.array(spans), 0.5, np.zeros(len(spans), np.int64))
    return FlightEstimate((), flight, np.random.default_rng(seed).normal(0, 20, (flight.controls, 3)) + 50.0)


def every(estimate: FlightEstimate) -> NDArray[np.bool_]:
    """As if two cameras bore on all of it."""
    return np.ones(len(estimate.control), bool)


def system(estimate: FlightEstimate) -> tuple[Array, Array, Array]:
    """The dense curvature (3M, 3M) that the prior puts into the band, its slack, and its gradient of half the cost."""
    normal = Normal.zero(len(estimate.control), 0)
    Smoothness.at(estimate, WEIGHT, every(estimate)).add_to(normal, estimate)
    M = len(estimate.control)
    dense = np.zeros((3 * M, 3 * M))
    for k in range(ORDER):
        for m in range(M - k):
            dense[3 * m : 3 * m + 3, 3 * (m + k) : 3 * (m + k) + 3] = normal.block[k, m]
            dense[3 * (m + k) : 3 * (m + k) + 3, 3 * m : 3 * m + 3] = normal.block[k, m].T
    return dense, normal.slack, -normal.right_control.ravel()


def unchanging(estimate: FlightEstimate) -> Array:
    """(3M, 12) three shifts of the whole flight, and nine linear maps."""
    away = estimate.control - estimate.control.mean(0)
    shifts = [np.broadcast_to(axis, away.shape) for axis in np.eye(3)]
    maps = [np.outer(away[:, k], axis) for axis in np.eye(3) for k in range(3)]
    return np.array([one.ravel() for one in (*shifts, *maps)]).T


@given(seed=st.integers(0, 10**6), scale=st.floats(0.1, 10))
def test_moving_turning_scaling_and_stretching_the_whole_costs_nothing(seed: int, scale: float) -> None:
    estimate, rng = flown(seed), np.random.default_rng(seed)
    prior = Smoothness.at(estimate, WEIGHT, every(estimate))
    stretch = scale * rotation(rng.normal(size=3).tolist()) @ np.diag(rng.uniform(0.5, 2.0, 3))
    stretch = stretch @ rotation(rng.normal(size=3).tolist())
    control = estimate.control @ stretch.T + rng.normal(0, 100, 3)
    # An extent that is none any more (FLAT) at a twentieth of the size.
    assert prior.cost(replace(estimate, control=control)) == pytest.approx(prior.cost(estimate), rel=1e-5)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), spans=st.sampled_from([(1,), (9,), (4, 6), (1, 1, 1)]))
def test_no_curvature_along_what_changes_nothing_and_all_of_it_across(seed: int, spans: tuple[int, ...]) -> None:
    estimate = flown(seed, spans)
    dense, slack, _ = system(estimate)
    left, along = dense - slack @ slack.T, unchanging(estimate)
    size = np.abs(np.diag(dense)).max()
    # Relative to the curvature along them before: rounding of sums of M terms.
    assert np.abs(left @ along).max() < 1e-10 * size * np.abs(along).max()
    assert np.linalg.eigvalsh(left)[0] > -1e-10 * size
    # Across in the sense of the curvature: v' H t = 0 for all of them.
    random = np.random.default_rng(seed).normal(size=len(dense))
    coupled = along.T @ dense
    across = random - along @ (np.linalg.pinv(coupled @ along) @ (coupled @ random))
    assert across @ left @ across == pytest.approx(across @ dense @ across, rel=1e-6)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_the_pull_is_the_slope_of_the_cost(seed: int) -> None:
    estimate = flown(seed)
    prior, (_, _, gradient) = Smoothness.at(estimate, WEIGHT, every(estimate)), system(estimate)
    direction = np.random.default_rng(seed + 1).normal(size=estimate.control.shape)
    step = 1e-3

    def cost(by: float) -> float:
        return prior.cost(replace(estimate, control=estimate.control + by * direction))

    slope = (cost(step) - cost(-step)) / (2 * step)
    # The cost's own rounding, 1e-16 of it, over the step.
    assert slope / 2 == pytest.approx(float(gradient @ direction.ravel()), rel=1e-5, abs=1e-12 * cost(0.0))


@given(seed=st.integers(0, 10**6), far_m=st.floats(1e2, 1e7))
def test_what_nobody_sees_gains_nothing_by_flying_off(seed: int, far_m: float) -> None:
    """Counted in, it made the flight so large that jerk cost nothing any more."""
    estimate = flown(seed)
    borne = every(estimate)
    borne[:4] = False
    prior = Smoothness.at(estimate, WEIGHT, borne)
    away = np.random.default_rng(seed).normal(size=estimate.control.shape) * far_m
    moved = replace(estimate, control=estimate.control + away * ~borne[:, None])
    counted = float((jerk(moved.flight, moved.control) ** 2).sum()) * moved.flight.spacing_s * WEIGHT
    assert prior.cost(moved) == pytest.approx(counted, rel=1e-12), "all its jerk counts, however far it flew"


def test_two_cameras_bear_on_a_point_where_rows_of_both_fall() -> None:
    estimate = flown(1, (9, 9))
    flight = estimate.flight
    one = flight.locate(np.array([0.1, 1.0, 4.0]), np.zeros(3, np.int64))
    two = flight.locate(np.array([1.1, 19.5, 22.0]), np.array([0, 1, 1]))
    all_valid = np.ones(3, bool)
    found = borne_by_two([(one, all_valid), (two, all_valid)], flight.controls)
    shared = set(one.controls().ravel()) & set(two.controls().ravel())
    assert shared
    assert set(np.nonzero(found)[0]) == shared
    assert not borne_by_two([(one, all_valid), (two, ~all_valid)], flight.controls).any()


def bent(x: Array) -> Array:
    return np.column_stack([x, 2 * x, -x]) * 5.0


@pytest.mark.parametrize(
    ("shape", "rank"),
    [
        (lambda k: np.random.default_rng(1).normal(0, 20, (len(k), 3)), 9),  # every linear map
        (lambda k: bent(np.sin(k)), 3),  # in a line: what is across it moves nothing
        (bent, 0),  # at an even pace: there is no jerk, and nothing to take out
    ],
)
def test_directions_that_do_not_curve_are_not_taken_out(shape: Callable[[Array], Array], rank: int) -> None:
    estimate = flown(0)
    control = shape(np.arange(len(estimate.control), dtype=float))
    _, slack, _ = system(replace(estimate, control=control))
    assert slack.shape == (3 * len(control), rank)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_roll_that_two_surveyed_cameras_leave_open_is_open(seed: int) -> None:
    """No prior but the survey's two points: nothing says how far the world is rolled about the line between them.

    A smoothness with curvature along a turn used to hold it to some hundredths of a radian.
    """
    truth = simulate(site(offsets_s=(0.0, 0.0), seed=seed))
    with pytest.raises(CalibrationError, match="determine"):
        solve(truth.scene, start=truth.network)
