"""Fault isolation: the score is what a fit would gain, a cause is told where the flight tells it, else both are."""

from dataclasses import replace

import numpy as np
import pytest

from calib.guarding.diagnosis import (
    CLOCK_BELIEF,
    STEP_SIGMA_S,
    TURN_SIGMA_RAD,
    Contradiction,
    ExpectedErrors,
    contradictions,
    judge,
)
from calib.guarding.evidence import FAULT_SIZE
from calib.guarding.memory import EvidenceMemory
from calib.guarding.sums import Sums, summed
from calib.network import POSE_SIZE
from tests.calib.guarding.slices import expected_of, slices_of
from tools.doubles.faults import CameraFault, faulty_frames
from tools.doubles.flight import Scene, Spec, frames, make

CAMERAS = 4
SPEC = Spec(cameras=CAMERAS, uavs=2, rate_hz=15.0, duration_s=6.0, noise_px=0.6, seed=3)


def random_sums(rng: np.random.Generator) -> tuple[Sums, np.ndarray, np.ndarray]:
    """Normal equations of random rows, and the rows."""
    design = rng.normal(size=(80, CAMERAS * FAULT_SIZE))
    off = rng.normal(size=80)
    return always(design.T @ design, design.T @ off, float(off @ off)), design, off


def always(normal: np.ndarray, right: np.ndarray, squares: float) -> Sums:
    """Of a change with nothing from before it."""
    return Sums(normal, normal, normal, right, right, squares, 80)


def test_a_score_is_what_a_fit_with_that_change_takes_off_the_sum_of_squares() -> None:
    rng = np.random.default_rng(7)
    sums, design, off = random_sums(rng)
    size = CAMERAS * FAULT_SIZE
    inverse = np.diag(rng.uniform(0.5, 2.0, size))
    expected = ExpectedErrors(np.zeros(size), inverse, np.full(CAMERAS, 1000.0), np.full(CAMERAS, np.inf))

    def least(columns: np.ndarray, prior: np.ndarray) -> float:
        rows = np.vstack([columns, np.linalg.cholesky(prior).T])
        right = np.concatenate([off, np.zeros(len(prior))])
        return float(np.linalg.lstsq(rows, right)[1][0])

    nothing = least(design, inverse)
    for found in contradictions(sums, expected).found:
        own = found.camera * FAULT_SIZE
        for at, sigma, score in (
            (own + np.arange(3), TURN_SIGMA_RAD, found.by_turn),
            (own + np.array([POSE_SIZE]), STEP_SIGMA_S, found.by_step),
        ):
            prior = np.block(
                [
                    [inverse, np.zeros((size, len(at)))],
                    [np.zeros((len(at), size)), np.eye(len(at)) / sigma**2],
                ]
            )
            gained = nothing - least(np.column_stack([design, design[:, at]]), prior)
            # Solved in two ways in double precision.
            assert score == pytest.approx(gained, rel=1e-6, abs=1e-6)


def test_clocks_are_held_against_where_they_are_expected() -> None:
    sums, _, _ = random_sums(np.random.default_rng(8))
    size = CAMERAS * FAULT_SIZE
    mean = np.random.default_rng(9).normal(size=size)
    moved = always(sums.normal, sums.right + sums.normal @ mean, sums.squares)
    focal, bound = np.full(CAMERAS, 1000.0), np.full(CAMERAS, np.inf)
    plain = contradictions(sums, ExpectedErrors(np.zeros(size), np.eye(size), focal, bound))
    about = contradictions(moved, ExpectedErrors(mean, np.eye(size), focal, bound))
    assert [one.score for one in about.found] == pytest.approx([one.score for one in plain.found])


def verdict_of(scene: Scene, fault: CameraFault | None, bound_s: float | None = 0.001):  # type: ignore[no-untyped-def]
    stream = frames(scene) if fault is None else faulty_frames(scene, fault, 0.0)
    slices = slices_of(scene, stream)
    return judge(slices, summed(slices, scene.spec.cameras), expected_of(scene, bound_s))


def test_noise_and_what_the_network_itself_does_not_know_is_no_fault() -> None:
    assert not verdict_of(make(SPEC), None).astray
    # Two milliradians are 2.6 px: that much is expected where the network says so.
    assert not verdict_of(make(replace(SPEC, sigma_attitude_rad=2e-3)), None).astray


@pytest.mark.parametrize(
    ("fault", "cause", "bound_s"),
    [
        (CameraFault("turned", turn_deg=0.4), "knock", 0.001),
        (CameraFault("turned", turn_deg=0.4), "knock", None),
        (CameraFault("stepped", step_s=0.2), "clock", 0.001),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_the_right_camera_and_cause_though_a_clock_states_a_bound(
    fault: CameraFault, cause: str, bound_s: float | None
) -> None:
    verdict = verdict_of(make(SPEC), fault, bound_s)
    assert verdict.astray
    assert verdict.named
    assert (verdict.worst.camera, verdict.worst.cause) == (2, cause)


def test_three_cameras_contradict_each_other_and_none_is_named() -> None:
    for seed in range(5):
        verdict = verdict_of(make(replace(SPEC, cameras=3, seed=seed)), CameraFault("turned", turn_deg=1.0))
        assert verdict.astray
        assert not verdict.named


def test_where_the_flight_does_not_tell_both_causes_are_told_unless_the_clock_states_a_bound() -> None:
    told = Contradiction(0, 100.0, np.zeros(3), 0.25, 1.0, 100.0, 100.0)
    assert told.cause == "either"
    assert replace(told, knock_odds=1.0 + CLOCK_BELIEF).cause == "knock", "250 times the bound is no explanation"


def test_an_object_keeps_its_number_while_any_camera_keeps_its_own() -> None:
    slices = slices_of(make(SPEC), frames(make(SPEC)))
    numbers = {number for one in slices for number, _ in one.objects}
    assert len(numbers) == SPEC.uavs
    memory = EvidenceMemory(10**9)
    first = [found for _, found in slices[0].objects]
    renumbered = [replace(found, keys=tuple((camera, label + 50) for camera, label in found.keys)) for found in first]
    memory.add(slices[0].t_unix_ns, first)
    memory.add(slices[0].t_unix_ns + 1, renumbered)
    assert {n for n, _ in memory.since(0)[0].objects}.isdisjoint({n for n, _ in memory.since(0)[1].objects})
