"""The flight as a uniform cubic B-spline: partition of unity, its derivative, polynomials exactly, stretches."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.adjustment.flight import jerk
from calib.geometry.spline import Flight, evaluate, lay_knots, relaid, velocity

FLIGHT = Flight(np.array([10.0, 40.0]), np.array([6, 3]), 0.5, np.array([0, 1]))
inside = st.floats(10.0, 13.0)


def located(t_s: float, stretch: int = 0):  # type: ignore[no-untyped-def]
    return FLIGHT.locate(np.array([t_s]), np.array([stretch]))


def control_of(power: int) -> np.ndarray:
    """Control points of t^power on the first stretch, by the spline's values at sites enough to fix them."""
    t = np.linspace(10.0, 13.0, 40)
    where = FLIGHT.locate(t, np.zeros(40, int))
    matrix = np.zeros((40, FLIGHT.controls))
    for row, (first, weights) in enumerate(zip(where.first, where.weights(), strict=True)):
        matrix[row, first : first + 4] = weights
    return np.linalg.lstsq(matrix[:, :9], np.tile(((t - 11) ** power)[:, None], 3), rcond=None)[0]


@given(t=inside)
def test_weights_are_a_partition_of_unity(t: float) -> None:
    assert located(t).weights().sum() == pytest.approx(1.0, abs=1e-14)
    assert located(t).velocity_weights().sum() == pytest.approx(0.0, abs=1e-12)
    # Sums of four products below 1: where 0 is due, they leave some 1e-17 of either sign, as the BLAS adds them up.
    assert (located(t).weights() >= -1e-15).all()


@given(t=st.floats(10.01, 12.99), seed=st.integers(0, 1000))
def test_velocity_is_the_derivative(t: float, seed: int) -> None:
    control = np.random.default_rng(seed).normal(size=(FLIGHT.controls, 3))
    step = 1e-5
    slope = (evaluate(located(t + step), control) - evaluate(located(t - step), control)) / (2 * step)
    # The third derivative jumps by at most some 8 / h^3 = 500 m/s^3; half of that times step^2.
    assert velocity(located(t), control) == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("power", [0, 1, 2, 3])
def test_cubics_are_followed_exactly(power: int) -> None:
    control = np.vstack([control_of(power), np.zeros((6, 3))])
    for t in np.linspace(10.0, 13.0, 13):
        assert evaluate(located(t), control)[0] == pytest.approx((t - 11) ** power, abs=1e-12)
    third = jerk(FLIGHT, control)[:6]
    assert third == pytest.approx(np.full((6, 3), 6.0 if power == 3 else 0.0), abs=1e-9)


@given(seed=st.integers(0, 1000), knot=st.integers(1, 5))
def test_two_derivatives_are_continuous_at_a_knot(seed: int, knot: int) -> None:
    control = np.random.default_rng(seed).normal(size=(FLIGHT.controls, 3))
    t, step = 10.0 + 0.5 * knot, 1e-9
    assert evaluate(located(t - step), control) == pytest.approx(evaluate(located(t), control), abs=1e-7)
    assert velocity(located(t - step), control) == pytest.approx(velocity(located(t), control), abs=1e-6)


def test_stretches_keep_their_own_control_points_and_objects() -> None:
    assert FLIGHT.first_control.tolist() == [0, 9]
    assert FLIGHT.controls == 15
    assert FLIGHT.piece_controls.tolist() == [0, 1, 2, 3, 4, 5, 9, 10, 11]
    t = np.array([9.9, 10.0, 13.0, 13.1, 41.0, 41.0])
    target = np.array([0, 0, 0, 0, 1, 0])
    assert FLIGHT.stretch_of(t, target).tolist() == [-1, 0, 0, -1, 1, -1]


@given(
    times=st.lists(st.floats(0, 100), min_size=1, max_size=60, unique=True),
    spacing=st.floats(0.1, 2.0),
    gap=st.floats(0.5, 10.0),
)
def test_knots_cover_every_time_and_break_at_gaps(times: list[float], spacing: float, gap: float) -> None:
    t = np.array(times)
    flight = lay_knots(t, np.zeros(len(t), np.int64), spacing, gap)
    assert (flight.stretch_of(t, np.zeros(len(t), np.int64)) >= 0).all()
    assert len(flight.spans) == 1 + int((np.diff(np.sort(t)) > gap).sum())


@given(seed=st.integers(0, 1000), later_s=st.floats(-100.0, 100.0))
def test_on_the_same_knots_control_points_come_back_whatever_the_time_is_called(seed: int, later_s: float) -> None:
    control = np.random.default_rng(seed).normal(size=(FLIGHT.controls, 3))
    later = replace(FLIGHT, start_s=FLIGHT.start_s + later_s)
    assert relaid(control, FLIGHT, later, later_s) == pytest.approx(control, abs=1e-9)


@given(shift=st.floats(-0.4, 0.4), more=st.integers(-1, 0))
def test_a_cubic_is_the_same_on_knots_that_lie_elsewhere(shift: float, more: int) -> None:
    old = Flight(np.array([10.0]), np.array([12]), 0.5, np.array([3]))
    knots = 10.0 + (np.arange(old.controls) - 1) * 0.5
    control = np.column_stack([knots, knots**2 - 0.5**2 / 3, knots**3 - knots * 0.5**2])  # f - h^2 f'' / 6
    new = Flight(np.array([10.0 + shift]), np.array([12 + more]), 0.5, np.array([3]))
    t = np.linspace(10.5, 15.0, 40)
    found = evaluate(new.locate(t, np.zeros(40, np.int64)), relaid(control, old, new, 0.0))
    assert found == pytest.approx(np.column_stack([t, t**2, t**3]), abs=1e-8)


def test_what_was_not_flown_is_not_made_up() -> None:
    control = np.ones((FLIGHT.controls, 3))
    longer = replace(FLIGHT, spans=FLIGHT.spans + np.array([0, 4]))
    found = relaid(control, FLIGHT, longer, 0.0)
    assert np.isfinite(found[:9]).all()
    assert np.isnan(found[9:]).all()
    assert np.isnan(relaid(control, FLIGHT, replace(FLIGHT, target=np.array([5, 6])), 0.0)).all()
