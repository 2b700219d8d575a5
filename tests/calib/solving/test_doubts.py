"""What people get wrong: each thing once, in the unknowns it moves, by as much as it says, seldom in all."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.adjustment.joint_prior import JointPrior
from calib.adjustment.projection import CAMERA_SIZE, CENTRE, LENS, OFFSET, RATE, centre_of, unknowns_of
from calib.solving.doubts import (
    MOST_PAIRED,
    RARE_ODDS,
    RATE_OF_CLOCK,
    USUAL_ODDS,
    Claim,
    Doubt,
    all_doubts,
    directions,
)
from tests.calib.solving.claims import prior, priors


def covariance(doubt: Doubt, of: JointPrior) -> np.ndarray:
    """(14 C, 14 C) of an error as large as the doubt says."""
    parts = doubt.size * directions(doubt, of)
    return parts @ parts.T


@pytest.mark.parametrize("cameras", [1, 2, 3, 6])
def test_every_hypothesis_stands_once(cameras: int) -> None:
    found = list(all_doubts(priors(cameras)))
    assert max(Counter(found).values()) == 1
    names = {one.mean.id for one in priors(cameras).cameras}
    for claim in set(Claim) - {Claim.EVERYTHING}:
        assert {one.cameras[0] for one in found if one.claim is claim and len(one.cameras) == 1} == names


@pytest.mark.parametrize("cameras", [3, 4, 8, 12, 16])
def test_a_good_site_is_far_more_probable_than_a_bad_one(cameras: int) -> None:
    """Odds of something being wrong with a camera add up over the cameras, and over nothing else."""
    total = sum(one.odds for one in all_doubts(priors(cameras)))
    by_camera = 4 * USUAL_ODDS + RARE_ODDS  # position, height, lens, clock; distortion
    of_all = 2 * USUAL_ODDS + RARE_ODDS + USUAL_ODDS + RARE_ODDS + USUAL_ODDS  # the last: of everything
    pairs = 2 * RARE_ODDS if cameras <= MOST_PAIRED else 0.0
    assert total == pytest.approx(cameras * by_camera + of_all + pairs)


def test_pairs_are_tried_up_to_a_number_that_grows_as_the_square() -> None:
    def pairs(cameras: int) -> int:
        return len(
            {d.cameras for d in all_doubts(priors(cameras)) if d.claim is Claim.POSITION and len(d.cameras) == 2}
        )

    assert pairs(6) == 15
    assert pairs(MOST_PAIRED) == MOST_PAIRED * (MOST_PAIRED - 1) / 2
    assert pairs(MOST_PAIRED + 1) == 0


def test_what_nobody_claims_nobody_doubts() -> None:
    """A camera without a survey, and one whose clock says nothing of itself."""
    unsurveyed = replace(prior("b"), centre_information=np.zeros((3, 3)))
    silent = replace(prior("c"), sigma=np.where(np.arange(CAMERA_SIZE) == OFFSET, np.inf, prior("c").sigma))
    found = list(all_doubts(JointPrior((prior("a", reference=True), unsurveyed, silent))))
    assert {name for one in found if one.claim is Claim.POSITION for name in one.cameras} == {"a", "c"}
    assert {name for one in found if one.claim is Claim.CLOCK for name in one.cameras} == {"a", "b"}


def test_cameras_of_other_types_are_not_off_together() -> None:
    other = prior("c")
    lens = replace(other.mean.lens, intrinsics=(1500.0, 1500.0, 960.0, 540.0))
    mixed = JointPrior((prior("a"), prior("b"), replace(other, mean=replace(other.mean, lens=lens))))
    assert {one.cameras for one in all_doubts(mixed) if one.together and one.claim is Claim.LENS} == {("a", "b")}
    assert ("a", "b", "c") in {one.cameras for one in all_doubts(mixed) if one.claim is Claim.LENS}


@given(size=st.floats(0.01, 300), camera=st.sampled_from("abcd"))
def test_a_position_is_off_by_as_much_in_each_axis(size: float, camera: str) -> None:
    added = covariance(Doubt(Claim.POSITION, (camera,), size, 1.0), priors(4))
    at = centre_of("abcd".index(camera))
    assert added[at, at] == pytest.approx(np.eye(3) * size**2)
    assert np.count_nonzero(added) == 3


def test_a_height_is_off_and_nothing_else_of_the_position() -> None:
    added = covariance(Doubt(Claim.POSITION, ("b", "c"), 30.0, 1.0, together=True, vertical=True), priors(4))
    up = [centre_of(index).stop - 1 for index in (1, 2)]
    assert added[np.ix_(up, up)] == pytest.approx(np.full((2, 2), 900.0))  # by the same: the geoid's height there
    assert np.count_nonzero(added) == 4


def test_two_positions_are_off_each_by_itself() -> None:
    added = covariance(Doubt(Claim.POSITION, ("a", "c"), 2.0, 1.0), priors(3))
    assert added[CENTRE, centre_of(2)] == pytest.approx(np.zeros((3, 3)))
    assert np.trace(added) == pytest.approx(6 * 4.0)


def test_another_zoom_moves_both_focal_lengths_by_one_factor() -> None:
    added = covariance(Doubt(Claim.LENS, ("a",), 0.1, 1.0), priors(2))
    fx, fy = LENS.start, LENS.start + 1
    assert added[fx, fx] == added[fx, fy] == added[fy, fy] == pytest.approx(100.0**2)
    assert added[fx, fx + 2] == 0.0  # the principal point moves by itself, and less
    assert 0 < added[fx + 2, fx + 2] < 100.0**2


def test_lens_files_of_one_type_are_off_together_or_each_by_itself() -> None:
    of, names = priors(3), ("a", "b", "c")
    alike = covariance(Doubt(Claim.LENS, names, 0.1, 1.0, together=True), of)
    apart = covariance(Doubt(Claim.LENS, names, 0.1, 1.0), of)
    assert np.diag(alike) == pytest.approx(np.diag(apart))
    first, second = LENS.start, CAMERA_SIZE + LENS.start
    assert alike[first, second] == pytest.approx(alike[first, first])
    assert apart[first, second] == 0.0
    assert np.linalg.matrix_rank(alike) == 3
    assert np.linalg.matrix_rank(apart) == 9


def test_distortion_moves_the_refined_coefficient_alone() -> None:
    moved = directions(Doubt(Claim.DISTORTION, ("b",), 0.1, 1.0), priors(2))
    assert np.flatnonzero(moved.any(axis=1)).tolist() == [CAMERA_SIZE + LENS.stop - 1]


def test_a_clock_is_off_in_offset_and_rate() -> None:
    moved = directions(Doubt(Claim.CLOCK, ("b",), 1.0, 1.0), priors(2))
    assert moved[unknowns_of(1)][OFFSET].tolist() == [1.0, 0.0, 0.0]
    assert moved[unknowns_of(1)][RATE].tolist() == [0.0, RATE_OF_CLOCK, 0.0]


def test_the_clock_that_is_the_sites_time_moves_all_others_the_other_way() -> None:
    """It is held fixed: were it off by itself, no unknown would say so."""
    of = priors(3)
    assert of.cameras[0].fixed[OFFSET]
    moved = directions(Doubt(Claim.CLOCK, ("a",), 1.0, 1.0), of)
    assert not moved[unknowns_of(0)].any()
    for other in (1, 2):
        assert moved[unknowns_of(other)] == pytest.approx(
            -directions(Doubt(Claim.CLOCK, ("abc"[other],), 1.0, 1.0), of)[unknowns_of(other)]
        )


def test_a_camera_that_is_gone_moves_nothing() -> None:
    assert not directions(Doubt(Claim.POSITION, ("gone",), 1.0, 1.0), priors(2)).any()
