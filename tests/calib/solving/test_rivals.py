"""Explanations gone on with: the world turned leaves the pixels, and the right one of two costs less."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.adjustment.bundle import Adjusted, adjust
from calib.adjustment.flight import FlightEstimate
from calib.adjustment.priors import camera_priors
from calib.adjustment.problem import Problem
from calib.adjustment.weights import Weights
from calib.geometry.rotation import rotation
from calib.geometry.similarity import Similarity
from calib.geometry.spline import Flight, evaluate
from calib.network import Camera
from calib.observations import SiteCamera
from calib.simulation.simulation import simulate
from calib.solving.bootstrap import first_estimate
from calib.solving.doubts import Claim, Doubt
from calib.solving.initial_estimate import from_network
from calib.solving.inputs import prepare
from calib.solving.rivals import MOST_RIVALS, told_apart, turned
from calib.solving.strain import UNLIKELY, Believed
from tests.calib.flights import site
from tests.calib.solving.claims import LENS_MODEL

Mistyped = tuple[Adjusted, Problem, dict[str, SiteCamera]]


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), scale=st.floats(0.2, 5))
def test_turning_the_world_leaves_what_cameras_see(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    flight = Flight(np.array([0.0]), np.array([6]), 0.5, np.array([0]))
    control = rng.normal(0, 3, (flight.controls, 3)) + np.array([0.0, 0.0, 50.0])
    camera = Camera("a", LENS_MODEL, rotation(rng.normal(0, 0.1, 3).tolist()), rng.normal(size=3))
    similarity = Similarity(scale, rotation(rng.normal(size=3).tolist()), rng.normal(0, 100, 3))
    before = FlightEstimate((camera,), flight, control)
    after = turned(before, similarity)
    located = flight.locate(np.linspace(0.1, 2.9, 20), np.zeros(20, np.int64))
    pixels = [one.cameras[0].project(evaluate(located, one.control)) for one in (before, after)]
    assert pixels[1] == pytest.approx(pixels[0], abs=1e-6)


def position(name: str, probability: float, size: float = 100.0) -> Believed:
    return Believed(Doubt(Claim.POSITION, (name,), size, 1e-3), probability)


@pytest.fixture(scope="module")
def mistyped() -> Mistyped:
    """Four cameras, the height of cam2 48 m too low, adjusted as if all were as claimed."""
    wrong = {"cam2": {"survey_error_m": (0.0, 0.0, -48.0)}}
    truth = simulate(site(offsets_s=(0.0,) * 4, duration_s=30.0, frame_rate_hz=5.0, special=wrong))
    inputs = prepare(truth.scene)
    begun = from_network(inputs, truth.network)
    estimate, data = first_estimate(
        inputs.scene, begun.cameras, inputs.tracks, begun.objects, t_mid=inputs.t_mid_unix_ns, spacing_s=0.5
    )
    problem = Problem(data, camera_priors(begun.cameras, inputs.sites))
    weights = Weights(np.full(4, 5.0), problem.interval_s, 0.0, 10.0)
    return adjust(problem, estimate, weights, 3), problem, inputs.sites


@pytest.mark.parametrize("order", [(1, 2, 3, 4), (4, 3, 2, 1)])
def test_the_right_one_of_four_is_left(mistyped: Mistyped, order: tuple[int, ...]) -> None:
    """However probable each seemed before, and in whatever order they come.

    By a few squared sigmas only: the weights are those of an adjustment that could not be right, eight times too wide.
    """
    rivals = tuple(position(f"cam{k}", 0.4 if k == 1 else 0.2) for k in order)
    left = told_apart(*mistyped, rivals)
    assert left[0].doubt.cameras == ("cam2",)
    assert left[0].probability > 0.5
    assert all(one.probability > UNLIKELY for one in left)
    assert sum(one.probability for one in left) == pytest.approx(sum(one.probability for one in rivals), abs=0.05)


def test_one_explanation_or_too_many_are_left_as_they_are(mistyped: Mistyped) -> None:
    alone = (position("cam1", 0.6),)
    many = tuple(position("cam2", 0.1, size) for size in np.geomspace(1, 100, MOST_RIVALS + 1).tolist())
    for doubts in ((), alone, many):
        assert told_apart(*mistyped, doubts) == doubts


def test_what_is_certain_stays_beside_what_is_told_apart(mistyped: Mistyped) -> None:
    certain = position("cam2", 0.99)
    left = told_apart(*mistyped, (certain, position("cam1", 0.5), position("cam3", 0.4)))
    assert left[0] == certain
    assert sum(one.probability for one in left[1:]) == pytest.approx(0.9, abs=0.05)


def test_that_all_are_off_is_no_better_explanation_than_that_one_is(mistyped: Mistyped) -> None:
    """Twelve numbers that may be anything fit whatever three fit: they pay by the room they did not need."""
    everybody = Believed(Doubt(Claim.POSITION, ("cam1", "cam2", "cam3", "cam4"), 30.0, 1e-3), 0.9)
    left = told_apart(*mistyped, (everybody, position("cam2", 0.1)))
    assert left[0].doubt.cameras == ("cam2",)
    assert left[0].probability > 0.5
