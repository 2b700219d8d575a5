"""Clocks from candidates that contradict each other."""

import pytest

from calib.solving.clock_consensus import Clock, consensus
from calib.solving.clocks import Alignment, Candidate

NEAR_S = 3.0


def said(*offsets: tuple[float, float], convincing: bool = False) -> Alignment:
    """Candidates (offset, score) of a pair that shares two minutes."""
    return Alignment(
        tuple(Candidate(offset, 0.0, 3.0, score, 120.0, 0.0, 60.0) for offset, score in offsets), None, convincing
    )


def test_a_loop_that_closes_outweighs_the_better_score() -> None:
    pairs = {
        ("a", "b"): said((10.0, 90.0), (2.0, 80.0)),
        ("b", "c"): said((1.0, 70.0)),
        ("a", "c"): said((3.0, 70.0)),
    }
    found = consensus(pairs, NEAR_S)
    assert found["b"].clock.seen_from(found["a"].clock).offset_s == pytest.approx(2.0)
    assert set(found["b"].agreeing) == {"a", "c"}


def test_a_camera_that_fits_in_two_places_is_not_certain_and_the_others_are() -> None:
    pairs = {
        ("a", "b"): said((0.0, 300.0)),
        ("a", "c"): said((0.0, 300.0)),
        ("b", "c"): said((0.0, 300.0)),
        ("a", "d"): said((20.0, 100.0), (30.0, 95.0)),
        ("b", "d"): said((20.0, 100.0), (30.0, 95.0)),
        ("c", "d"): said((20.0, 100.0), (30.0, 95.0)),
    }
    found = consensus(pairs, NEAR_S)
    assert not found["d"].certain
    assert all(found[name].certain for name in "abc")


def test_no_camera_is_the_middle_of_all() -> None:
    """The longest track is of a camera that fits nobody: the others are tied without it."""
    pairs = {("a", "b"): said(), ("a", "c"): said(), ("b", "c"): said((5.0, 300.0))}
    found = consensus(pairs, NEAR_S)
    assert set(found) == {"b", "c"}


def test_rates_go_around_a_loop() -> None:
    slow, fast = Clock(1.0, 1e-3), Clock(-2.0, -2e-3)
    seen = fast.seen_from(slow)
    assert slow.site(seen.site(7.0)) == pytest.approx(fast.site(7.0))
    assert seen.stamp(seen.site(7.0)) == pytest.approx(7.0)
