"""The survey against the cameras: false alarms as often as promised, and the wrong tripod named."""

import numpy as np
import pytest

from calib.solving.survey_check import FALSE_ALARM, GAUGE, check_survey, check_tape
from tools.doubles.survey_network import Drawn, draw, trial


def drawn_of(cameras: int, seed: int) -> Drawn:
    """A network."""
    return draw(cameras, np.random.default_rng(seed))


def test_cameras_know_nothing_of_place_attitude_and_scale() -> None:
    drawn = drawn_of(4, 1)
    values = np.linalg.eigvalsh(drawn.information)
    assert np.sum(values < 1e-6 * values[-1]) == GAUGE


def test_a_good_survey_is_called_wrong_as_often_as_promised() -> None:
    rng = np.random.default_rng(2)
    drawn = drawn_of(4, 3)
    alarms = sum(not trial(drawn, 0.0, rng)[0].passed for _ in range(1000))
    # Binomial, 1000 draws of 1 %: three sigma.
    assert alarms / 1000 == pytest.approx(FALSE_ALARM, abs=0.0095)


def test_the_statistic_is_chi_square() -> None:
    rng = np.random.default_rng(4)
    drawn = drawn_of(5, 5)
    verdicts = [trial(drawn, 0.0, rng)[0] for _ in range(1000)]
    assert verdicts[0].freedom == 8
    # Mean 8 of 1000 draws: standard error sqrt(16 / 1000) = 0.13; four of those.
    assert np.mean([verdict.statistic for verdict in verdicts]) == pytest.approx(8.0, abs=0.5)


def test_with_three_cameras_it_says_that_but_not_which() -> None:
    rng = np.random.default_rng(6)
    drawn = drawn_of(3, 7)
    verdicts = [trial(drawn, 1.0, rng)[0] for _ in range(50)]
    noticed = [verdict for verdict in verdicts if not verdict.passed]
    assert len(noticed) > 40
    assert all(verdict.suspect is None and "tell which" in str(verdict) for verdict in noticed)


def test_with_five_the_wrong_one_is_named_and_measured() -> None:
    rng = np.random.default_rng(8)
    drawn = drawn_of(5, 9)
    for _ in range(30):
        verdict, wrong = trial(drawn, 1.0, rng)
        assert verdict.suspect == wrong
        assert verdict.wrong_by_m is not None
        assert np.linalg.norm(verdict.wrong_by_m) == pytest.approx(1.0, abs=0.3)
        assert wrong in str(verdict)


def test_a_bias_common_to_all_cannot_be_seen() -> None:
    names = ["a", "b", "c", "d"]
    drawn = drawn_of(4, 10)
    prior = np.eye(12) * 1e-4
    covariance = np.linalg.inv(drawn.information + np.linalg.inv(prior))
    moved = drawn.centres_m + np.array([0.3, 0.2, -0.5])
    verdict = check_survey(names, moved, prior, moved, covariance)
    assert verdict.passed
    assert verdict.statistic == pytest.approx(0.0, abs=1e-6)


def test_what_the_cameras_cannot_tell_is_said() -> None:
    """Of a network that the cameras know in two directions only, the others are not called right."""
    drawn = drawn_of(4, 11)
    prior, names = np.eye(12) * 1e-4, ["a", "b", "c", "d"]
    values, vectors = np.linalg.eigh(drawn.information)
    for known, words in ((5, ""), (2, "; 3 of 5 directions are not tested"), (0, "not tested")):
        kept = vectors[:, 12 - known :] * values[12 - known :] @ vectors[:, 12 - known :].T
        covariance = np.linalg.inv(kept + np.linalg.inv(prior))
        verdict = check_survey(names, drawn.centres_m, prior, drawn.centres_m, covariance)
        assert (verdict.freedom, verdict.passed) == (known, True)
        assert words in str(verdict)
    whole = np.linalg.inv(drawn.information + np.linalg.inv(prior))
    assert "not tested" not in str(check_survey(names, drawn.centres_m, prior, drawn.centres_m, whole))


@pytest.mark.parametrize(("taped_m", "passed"), [(30.0, True), (30.02, True), (30.3, False)])
def test_a_taped_distance(taped_m: float, passed: bool) -> None:
    positions = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0]])
    check = check_tape(("cam1", "cam2"), positions, np.full((2, 3), 0.01), taped_m)
    assert check.passed is passed
    assert check.difference_m == pytest.approx(30.0 - taped_m)
    assert "cam1 to cam2" in str(check)
