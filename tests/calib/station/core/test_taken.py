"""Which networks a base takes: none that its own report would call bad, and what it says instead."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from calib.network import Network
from calib.station.config import CalibrationSection
from calib.station.core.calibration import Calibration, Phase
from calib.station.core.jobs import Solved, SolveResult
from tests.calib.station.conftest import Fed
from tools.doubles.flight import Spec, make

SPEC = Spec(cameras=4, uavs=1, rate_hz=10.0, duration_s=30.0, noise_px=0.5)
NETWORK = make(SPEC).network
CONTRADICTION = "claims: what is claimed of the site contradicts what the cameras saw: a is off, or b is off"
CURE = "correct what is wrong, and solve again"


def graded(grade: str) -> Solved:
    return Solved(NETWORK, 0.1, grade=grade, verdict=CONTRADICTION, improvement=CURE)


def asked() -> Calibration:
    """Waiting for the answer to its first job."""
    calibration = Calibration(CalibrationSection(), [camera.id for camera in NETWORK.cameras], "site")
    calibration._jobs = 1
    return calibration


@pytest.mark.parametrize(("grade", "taken"), [("A", True), ("B", True), ("C", True), ("D", False), ("E", False)])
def test_no_network_is_taken_that_would_be_graded_d_or_e(grade: str, taken: bool) -> None:
    calibration = asked()
    network = calibration.take(SolveResult(1, graded(grade), None, 1.0))
    assert (network is not None) is taken
    assert (calibration.network is not None) is taken


@pytest.mark.parametrize(
    ("solved", "why"),
    [
        (graded("D"), "graded D: claims: what is claimed"),
        (Solved(replace(NETWORK, rms_px=50.0), 0.1), "misses by 50.0 px"),
        (Solved(NETWORK, 50.0), "uncertain by 50.0 m"),
    ],
)
def test_the_network_in_force_stays_where_a_better_one_is_not_found(solved: Solved, why: str) -> None:
    calibration = asked()
    before = calibration.take(SolveResult(1, graded("A"), None, 1.0))
    assert calibration.take(SolveResult(1, solved, None, 1.0)) is None
    assert calibration.network is before
    assert why in calibration._failure


def test_a_good_answer_clears_what_the_one_before_failed_by() -> None:
    calibration = asked()
    calibration.take(SolveResult(1, graded("E"), None, 1.0))
    assert calibration.take(SolveResult(1, graded("C"), None, 1.0)) is not None
    assert calibration._failure == ""


def test_a_station_says_why_it_stays_uncalibrated_and_what_to_do(feed: Callable[..., Fed]) -> None:
    def contradicted(network: Network) -> Solved:
        return Solved(network, 0.1, grade="D", verdict=CONTRADICTION, improvement=CURE)

    fed = feed(SPEC, answer=contradicted)
    standing = fed.station.standing
    assert standing.phase is Phase.COLLECTING
    assert standing.reason == f"not calibrated: the best solution would be graded D: {CONTRADICTION}"
    assert standing.action == CURE
    assert fed.sent == []


def test_the_same_station_is_calibrated_by_the_same_network_with_a_c(feed: Callable[..., Fed]) -> None:
    fed = feed(SPEC, answer=lambda network: Solved(network, 0.1, grade="C", verdict=CONTRADICTION, improvement=CURE))
    assert fed.station.standing.phase is Phase.CALIBRATED
    assert len(fed.sent) > 0
