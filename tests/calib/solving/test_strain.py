"""Priors against pixels: the classical chi-square, the normal distribution's likelihoods, the right suspect."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from calib.adjustment.bundle import Adjusted, adjust
from calib.adjustment.flight import FlightEstimate
from calib.adjustment.normal import factorise
from calib.adjustment.priors import moved
from calib.adjustment.problem import Point, Problem
from calib.adjustment.projection import CAMERA_SIZE, LENS, centre_of, unknowns_of
from calib.adjustment.uncertainty import camera_covariance
from calib.errors import UndeterminedError
from calib.simulation.simulation import simulate
from calib.solving.doubts import Claim, Doubt, directions
from calib.solving.initial_estimate import from_network
from calib.solving.inputs import Inputs, prepare
from calib.solving.pixel_information import PixelInformation
from calib.solving.refine import Refined, refine
from calib.solving.strain import (
    CERTAIN,
    UNLIKELY,
    Believed,
    Weighing,
    most_probable_first,
    of_any_size,
    strain,
    widening,
)
from edge.common.arrays import Array
from tests.calib.flights import site
from tests.calib.solving.claims import Site, priors

GOOD = site(offsets_s=(0.0,) * 4, duration_s=40.0, frame_rate_hz=10.0)


def random_covariance(rng: np.random.Generator, size: int) -> Array:
    root = rng.normal(size=(size, 2 * size)) * rng.uniform(0.1, 10, size)[:, None]
    return root @ root.T / size


def linear(seed: int, size: int, rank: int) -> tuple[PixelInformation, Array, Array, Array]:
    """Pixels that see `rank` directions of `size` unknowns, in any units.

    With it the design (rank, size) whitened to a sigma of 1, what was seen (rank,), and the priors' covariance.
    """
    rng = np.random.default_rng(seed)
    design, covariance = rng.normal(size=(rank, size)), random_covariance(rng, size)
    seen = rng.normal(0, 5, rank)
    scale = np.exp(rng.normal(size=size))
    information = design.T @ design * np.outer(scale, scale)
    return PixelInformation(scale, information, design.T @ seen * scale), design, seen, covariance


@settings(max_examples=50)
@given(seed=st.integers(0, 10**6), size=st.integers(1, 8), share=st.floats(0.2, 1.0))
def test_the_statistic_is_the_classical_chi_square(seed: int, size: int, share: float) -> None:
    """y = A x + e, x ~ N(0, P): y' (A P A' + 1)^-1 y has rank(A) degrees of freedom, whatever the units of x."""
    rank = max(1, round(share * size))
    information, design, seen, covariance = linear(seed, size, rank)
    tested = information.against(covariance)
    predicted = design @ covariance @ design.T + np.eye(rank)
    if np.linalg.eigvalsh(design @ covariance @ design.T)[0] > 0.02:  # 0.01 and less is the untested
        assert len(tested.off) == rank
        assert tested.statistic == pytest.approx(seen @ np.linalg.solve(predicted, seen), rel=1e-6)
        assert tested.p_value == pytest.approx(stats.chi2.sf(tested.statistic, rank))
    assert len(tested.off) <= rank


@settings(max_examples=50)
@given(seed=st.integers(0, 10**6), size=st.integers(2, 8), widened=st.integers(1, 4), by=st.floats(0.1, 30))
def test_likelihoods_are_those_of_the_normal_distribution(seed: int, size: int, widened: int, by: float) -> None:
    """Of y ~ N(0, A (P + U U') A' + 1), up to what all hypotheses have in common."""
    information, design, seen, covariance = linear(seed, size, size)
    tested = information.against(covariance)
    if len(tested.off) < size:
        return
    parts = by * np.random.default_rng(seed + 1).normal(size=(size, widened))

    def theory(prior: Array) -> float:
        return float(stats.multivariate_normal(None, design @ prior @ design.T + np.eye(size)).logpdf(seen))

    gain = theory(covariance + parts @ parts.T) - theory(covariance)
    assert tested.gains(np.array([parts, 0 * parts])) == pytest.approx([gain, 0.0], rel=1e-6, abs=1e-6)
    wider = tested.widened(parts)
    assert wider.log_likelihood - tested.log_likelihood == pytest.approx(gain, rel=1e-6, abs=1e-6)
    more = wider.gains(parts[None])[0]  # widened twice by the same
    assert more + gain == pytest.approx(
        theory(covariance + 2 * parts @ parts.T) - theory(covariance), rel=1e-6, abs=1e-6
    )


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), size=st.integers(2, 6))
def test_units_do_not_matter(seed: int, size: int) -> None:
    one, _, _, covariance = linear(seed, size, size)
    unit = np.exp(np.random.default_rng(seed).normal(0, 5, size))
    other = PixelInformation(
        one.scale * unit, one.information, one.pull
    )  # the same sigmas in another unit: information and pull count sigmas
    assert other.against(covariance * np.outer(unit, unit)).statistic == pytest.approx(
        one.against(covariance).statistic, rel=1e-6
    )


def test_what_pixels_do_not_see_is_not_tested() -> None:
    blind = PixelInformation(np.ones(3), np.zeros((3, 3)), np.zeros(3))
    tested = blind.against(np.eye(3))
    assert (len(tested.off), tested.statistic, tested.p_value) == (0, 0.0, 1.0)


# Of sites that are drawn


def test_a_site_as_claimed_is_strained_as_chi_square_says() -> None:
    drawn, rng = Site.drawn(4, 1), np.random.default_rng(2)
    tested = [drawn.seen(rng).against(drawn.prior.claimed) for _ in range(400)]
    freedom = len(tested[0].off)
    # The mean of 400 draws has a sigma of sqrt(2 k / 400); p is uniform, and its quantiles are Kolmogorov's.
    assert np.mean([one.statistic for one in tested]) == pytest.approx(freedom, abs=4 * np.sqrt(2 * freedom / 400))
    assert stats.kstest([one.p_value for one in tested], "uniform").pvalue > 1e-3


def test_probabilities_add_up_with_as_claimed_among_them() -> None:
    drawn, rng = Site.drawn(4, 3), np.random.default_rng(4)
    for off_m in (0.0, 0.3, 30.0):
        off = np.zeros(len(drawn.prior.known))
        off[centre_of(1)] = off_m
        seen = drawn.seen(rng, off)
        as_claimed, doubts = Weighing(drawn.prior, seen).posterior(drawn.prior.claimed)
        assert as_claimed + sum(doubts.values()) == pytest.approx(1.0)
        assert min(doubts.values()) >= 0.0


def test_good_sites_are_seldom_doubted() -> None:
    """A site is doubted where something wrong is nine times as probable: by its odds of 7 % less than one in 100."""
    drawn, rng = Site.drawn(4, 5), np.random.default_rng(6)
    doubted = sum(bool(Weighing(drawn.prior, drawn.seen(rng)).strain().doubts) for _ in range(100))
    assert doubted <= 4  # three sigma of 1 in 100


@pytest.mark.parametrize("cameras", [4, 6])
@pytest.mark.parametrize("claim", [Claim.POSITION, Claim.LENS, Claim.DISTORTION, Claim.CLOCK])
def test_what_is_wrong_is_what_is_believed_wrong(cameras: int, claim: Claim) -> None:
    """Fifty and more sigmas off, each camera in turn: named, and the priors so allowed are strained no more."""
    drawn, rng = Site.drawn(cameras, 7), np.random.default_rng(8)
    size = {Claim.POSITION: 2.0, Claim.LENS: 0.3, Claim.DISTORTION: 0.3, Claim.CLOCK: 0.3}[claim]
    for one in drawn.prior.cameras[1:]:
        moves = directions(Doubt(claim, (one.mean.id,), size, 1.0), drawn.prior)
        found = Weighing(drawn.prior, drawn.seen(rng, size * moves @ np.ones(3))).strain()
        assert found.p_value < 1e-6
        assert found.p_value_allowed > 1e-3
        assert (found.doubts[0].doubt.claim, found.doubts[0].doubt.cameras) == (claim, (one.mean.id,))
        assert found.doubts[0].probability >= CERTAIN


def test_lens_files_that_are_all_off_alike_are_all_doubted_together() -> None:
    drawn, rng = Site.drawn(4, 9), np.random.default_rng(10)
    names = tuple(one.mean.id for one in drawn.prior.cameras)
    moves = directions(Doubt(Claim.LENS, names, 0.1, 1.0, together=True), drawn.prior)
    found = Weighing(drawn.prior, drawn.seen(rng, 0.1 * moves @ [1.0, 0.0, 0.0])).strain()
    assert found.doubts[0].doubt.about == (Claim.LENS, names, True)


def test_with_three_cameras_a_wrong_position_is_seen_and_nobody_named() -> None:
    """Two testable directions of a triangle: any tripod explains them."""
    drawn, rng = Site.drawn(3, 11), np.random.default_rng(12)
    for index in range(3):
        off = np.zeros(len(drawn.prior.known))
        off[centre_of(index)] = [1.0, -2.0, 0.5]
        found = Weighing(drawn.prior, drawn.seen(rng, off)).strain()
        assert found.p_value < 1e-6
        assert max(one.probability for one in found.doubts) < CERTAIN
        assert {name for one in found.doubts for name in one.doubt.cameras} == {"a", "b", "c"}


def test_two_things_wrong_at_once_are_both_allowed_for() -> None:
    drawn, rng = Site.drawn(6, 13), np.random.default_rng(14)
    off = np.zeros(len(drawn.prior.known))
    off[centre_of(1)] = [3.0, 1.0, -2.0]
    off[unknowns_of(4)][LENS.start : LENS.start + 2] = 200.0
    found = Weighing(drawn.prior, drawn.seen(rng, off)).strain()
    assert found.p_value_allowed > 1e-3
    sure = {(one.doubt.claim, one.doubt.cameras) for one in found.doubts if one.probability >= CERTAIN}
    assert sure >= {(Claim.POSITION, ("b",)), (Claim.LENS, ("e",))}


def test_doubts_are_told_most_probable_first_and_none_that_is_unlikely() -> None:
    drawn, rng = Site.drawn(3, 15), np.random.default_rng(16)
    off = np.zeros(len(drawn.prior.known))
    off[centre_of(0)] = 1.0
    doubts = Weighing(drawn.prior, drawn.seen(rng, off)).strain().doubts
    probable = [one.probability for one in doubts]
    assert probable == sorted(probable, reverse=True)
    assert min(probable) > UNLIKELY


def test_equally_probable_doubts_stand_in_one_order() -> None:
    """Rounding differs between processors; the answer does not."""
    one, two = (Doubt(Claim.POSITION, (name,), 1.0, 1e-2) for name in "ab")
    first = most_probable_first([Believed(two, 0.5), Believed(one, 0.5 - 1e-12)])
    assert [each.doubt.cameras for each in first] == [("a",), ("b",)]


# What doubts add


@given(sizes=st.lists(st.floats(0.1, 100), min_size=1, max_size=3))
def test_widening_adds_the_squares(sizes: list[float]) -> None:
    prior = priors(3)
    doubts = tuple(Believed(Doubt(Claim.POSITION, ("b",), size, 1.0), 1.0) for size in sizes)
    added = widening(doubts, prior)
    assert added[centre_of(1), centre_of(1)] == pytest.approx(np.eye(3) * np.sum(np.square(sizes)))
    assert np.count_nonzero(added) == 3


# Of a real adjustment


@pytest.fixture(scope="module")
def inputs() -> Inputs:
    """Of a good site."""
    return prepare(simulate(GOOD).scene)


@pytest.fixture(scope="module")
def refined(inputs: Inputs) -> Refined:
    """It, adjusted."""
    return refine(inputs, from_network(inputs, simulate(GOOD).network), 0.5)


def stopped_at(problem: Problem, estimate: FlightEstimate, settled: Adjusted) -> Adjusted:
    """An adjustment that was given up there."""
    point = Point.at(problem, estimate, settled.weights)
    normal = point.normal()
    return replace(settled, estimate=estimate, normal=normal, factor=factorise(normal), projected=point.projected)


def test_what_pixels_say_does_not_depend_on_what_was_believed_beforehand(refined: Refined) -> None:
    """The priors' part is taken out again: adjusting with one position unknown leaves the same pixels.

    To the second order in the noise: rays and rotations are not quite straight over the few centimetres in between.
    """
    problem = refined.problem
    doubt = Believed(Doubt(Claim.POSITION, ("cam2",), 1.0, 1.0), 1.0)
    widened = replace(problem, widened=widening((doubt,), problem.prior))
    other = adjust(widened, refined.adjusted.estimate, refined.adjusted.weights, 1)
    here = PixelInformation.of(refined.adjusted, problem).against(problem.prior.claimed)
    there = PixelInformation.of(other, widened).against(problem.prior.claimed)
    assert len(there.off) == len(here.off)
    assert there.statistic == pytest.approx(here.statistic, rel=0.05)


def test_what_pixels_say_does_not_depend_on_whether_the_adjustment_has_settled(refined: Refined) -> None:
    """Stopped where a position and a lens are still two sigmas from where they are bound for."""
    settled, problem = refined.adjusted, refined.problem
    sigma = np.sqrt(np.diag(camera_covariance(settled, problem)))
    off = np.zeros(len(sigma))
    off[centre_of(1)], off[unknowns_of(2)][LENS.start] = 2.0, -2.0
    steps = (off * sigma).reshape(-1, CAMERA_SIZE)
    cameras = tuple(moved(camera, step) for camera, step in zip(settled.estimate.cameras, steps, strict=True))
    # The flight follows, as it would have.
    control = settled.estimate.control - (settled.factor.carried @ steps.ravel()).reshape(-1, 3)
    before = replace(settled.estimate, cameras=cameras, control=control)
    stopped = stopped_at(problem, before, settled)
    here, there = (PixelInformation.of(one, problem).against(problem.prior.claimed) for one in (settled, stopped))
    assert there.statistic == pytest.approx(here.statistic, rel=0.05)


def test_a_good_site_is_as_claimed(refined: Refined, inputs: Inputs) -> None:
    found = strain(refined.adjusted, refined.problem, inputs.sites)
    assert found.doubts == ()
    assert found.p_value > 1e-3
    assert found.p_value_allowed == found.p_value
    assert f"{found.statistic:.1f} of {found.freedom}" in found.figures


def test_an_adjusted_position_moves_by_less_than_it_may(refined: Refined) -> None:
    """The covariance after is never larger than the prior's, in any direction: what W = 1 - L' C L rests on."""
    prior = refined.problem.prior
    after = camera_covariance(refined.adjusted, refined.problem)[np.ix_(prior.known, prior.known)]
    scale = np.sqrt(np.diag(prior.claimed))
    shrunk = (prior.claimed - after) / np.outer(scale, scale)
    assert np.linalg.eigvalsh(shrunk)[0] > -1e-6


def test_where_nothing_is_known_nothing_is_strained(refined: Refined, inputs: Inputs) -> None:
    free = tuple(
        replace(one, sigma=np.full(CAMERA_SIZE, np.inf), centre_information=np.zeros((3, 3)))
        for one in refined.problem.priors
    )
    found = strain(refined.adjusted, replace(refined.problem, priors=free), inputs.sites)
    assert (found.statistic, found.freedom, found.p_value, found.doubts) == (0.0, 0, 1.0, ())


def test_an_adjustment_that_ran_off_is_refused_and_not_weighed() -> None:
    """Two cameras, lenses opened wide: the distance went to infinity, and doubts of no probability were compared."""
    drawn = Site.drawn(2, 2)
    seen = drawn.seen(np.random.default_rng(0))
    nowhere = replace(seen, pull=np.full_like(seen.pull, np.nan))
    with pytest.raises(UndeterminedError, match="ran off"):
        Weighing(drawn.prior, nowhere).strain()


def test_sizes_that_nothing_tells_apart_are_all_allowed_for() -> None:
    """Of two cameras, a pair is all of them: as many sizes as a twentieth of the probability does not go into."""
    sizes = {
        Doubt(Claim.POSITION, ("cam0", "cam1"), size, 0.01): 0.01 for size in np.geomspace(0.1, 300.0, 40).tolist()
    }
    (found,) = of_any_size(sizes)
    assert found.doubt.size == pytest.approx(300.0)
    assert found.probability == pytest.approx(0.4)
