"""What cameras' priors share: what averages and what does not, what is known and what is free, and what it costs."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.adjustment.joint_prior import AXES_SHARE, TYPE_SHARES, JointPrior, of_one_type
from calib.adjustment.priors import FIXED, FREE, CameraPrior, moved
from calib.adjustment.projection import CAMERA_SIZE, CENTRE, LENS, OFFSET, ROTATION, unknowns_of
from calib.network import Camera
from edge.common.arrays import Array
from edge.lens import LensModel

LENS_MODEL = LensModel("radtan", (1000.0, 1000.0, 960.0, 540.0), (0.0,) * 4, (1920, 1080))
FX = LENS.start


def camera(name: str, focal: float = 1000.0, **lens: object) -> Camera:
    model = replace(LENS_MODEL, intrinsics=(focal, focal, 960.0, 540.0), **lens)  # type: ignore[arg-type]
    return Camera(name, model, np.eye(3), np.zeros(3))


def prior(name: str, focal: float = 1000.0, *, surveyed: bool = True, **lens: object) -> CameraPrior:
    """A camera of which position (1 cm) and lens (1 %) are known, clock and attitude not at all."""
    sigma = np.full(CAMERA_SIZE, FREE)
    sigma[LENS] = [0.01 * focal, 0.01 * focal, 10.0, 10.0, 0.01]
    return CameraPrior(camera(name, focal, **lens), sigma, np.eye(3) * 1e4 * surveyed)


def joint(count: int) -> JointPrior:
    return JointPrior(tuple(prior(f"cam{k}") for k in range(count)))


def focal_rows(of: JointPrior) -> list[int]:
    """Where the focal lengths fx stand among what is known."""
    place = np.cumsum(of.known) - 1
    return [int(place[CAMERA_SIZE * k + FX]) for k in range(len(of.cameras))]


def test_lens_files_of_one_type_are_of_equal_pictures_and_near_focal_lengths() -> None:
    one = camera("a")
    assert of_one_type(one, camera("b"))
    assert of_one_type(one, camera("b", 1040.0))
    assert not of_one_type(one, camera("b", 1100.0))
    assert not of_one_type(one, camera("b", size_px=(1280, 720)))
    assert not of_one_type(one, camera("b", model="fisheye"))
    assert not of_one_type(one, camera("b", focal_sigma_px=1.0))  # measured, camera by camera


@given(a=st.floats(500, 2000), b=st.floats(500, 2000))
def test_being_of_one_type_is_mutual_but_for_the_border(a: float, b: float) -> None:
    if abs(abs(np.log(a / b)) - 0.05) > 0.005:  # relative to the one or to the other: a tenth of the border apart
        assert of_one_type(camera("a", a), camera("b", b)) == of_one_type(camera("b", b), camera("a", a))


def test_what_is_free_fixed_or_surveyed_in_part_is_not_known() -> None:
    held = prior("a")
    held.sigma[OFFSET] = FIXED
    along = replace(prior("b"), centre_information=np.diag([1e4, 0.0, 0.0]))
    known = JointPrior((held, along)).known.reshape(2, CAMERA_SIZE)
    assert not known[:, ROTATION].any()
    assert not known[:, OFFSET].any()
    assert known[0, CENTRE].all()
    assert not known[1, CENTRE].any()
    assert known[:, LENS].all()


def test_focal_lengths_of_one_camera_err_alike_and_those_of_one_type_in_part() -> None:
    two = joint(2)
    (first, second), covariance = focal_rows(two), two.covariance
    assert covariance[first, first] == pytest.approx(100.0)
    assert covariance[first, first + 1] == pytest.approx(AXES_SHARE * 100.0)
    assert covariance[first, second] == pytest.approx(TYPE_SHARES * 100.0)
    assert covariance[first, second + 1] == pytest.approx(TYPE_SHARES * AXES_SHARE * 100.0)


@pytest.mark.parametrize("count", [2, 4, 8, 16])
def test_the_mean_of_many_lens_files_of_one_type_stays_uncertain(count: int) -> None:
    """The variance of a mean of n values with correlation s is (s + (1 - s) / n) of one's: it never falls below s."""
    every = joint(count)
    at = focal_rows(every)
    of_mean = float(every.covariance[np.ix_(at, at)].mean())
    assert of_mean == pytest.approx(100.0 * (TYPE_SHARES + (1 - TYPE_SHARES) / count))


def test_lens_files_of_other_types_and_positions_err_by_themselves() -> None:
    other = JointPrior((prior("a"), prior("b", 1500.0)))
    first, second = focal_rows(other)
    assert other.covariance[first, second] == 0.0
    full = np.zeros((2 * CAMERA_SIZE,) * 2)
    full[np.ix_(other.known, other.known)] = other.covariance
    assert not full[CENTRE, unknowns_of(1)].any()
    assert full[CENTRE, CENTRE] == pytest.approx(np.eye(3) * 1e-4)


def test_information_is_the_inverse_on_what_is_known_and_nothing_elsewhere() -> None:
    two = joint(2)
    known = two.known
    assert two.information[np.ix_(known, known)] @ two.covariance == pytest.approx(np.eye(int(known.sum())), abs=1e-9)
    assert not two.information[~known].any()


@given(seed=st.integers(0, 10**6), rank=st.integers(1, 5))
def test_priors_that_claim_less_cost_less(seed: int, rank: int) -> None:
    """(P + U U')^-1 <= P^-1: what is widened can only come to cost less."""
    rng = np.random.default_rng(seed)
    claimed = joint(3)
    parts = rng.normal(size=(3 * CAMERA_SIZE, rank)) * rng.uniform(0.01, 10)
    widened = replace(claimed, widened=parts @ parts.T)
    at = tuple(moved(one.mean, rng.normal(0, 0.01, CAMERA_SIZE)) for one in claimed.cameras)
    assert widened.cost(at) <= claimed.cost(at) * (1 + 1e-9) + 1e-9
    assert widened.claimed == pytest.approx(claimed.claimed)


def test_independent_priors_cost_the_sum_of_their_costs() -> None:
    away = np.zeros(CAMERA_SIZE)
    away[CENTRE] = [0.01, 0.0, -0.02]
    one = prior("a")
    alone = JointPrior((one,)).cost((moved(one.mean, away),))
    assert alone == pytest.approx(1.0 + 4.0)
    both = JointPrior((one, prior("b", 1500.0)))
    assert both.cost((moved(one.mean, away), both.cameras[1].mean)) == pytest.approx(alone)


def test_the_same_error_in_all_lens_files_is_cheaper_than_each_its_own() -> None:
    """All three 1 % too long costs 1' R^-1 1, R the correlation: less than three times one's own."""
    every = joint(3)

    def cost(shares: Array) -> float:
        steps = np.zeros((3, CAMERA_SIZE))
        steps[:, FX] = steps[:, FX + 1] = 10.0 * shares
        return every.cost(tuple(moved(one.mean, step) for one, step in zip(every.cameras, steps, strict=True)))

    alike, apart = cost(np.ones(3)), cost(np.array([1.0, -1.0, 1.0]))
    assert alike == pytest.approx(3 / (1 + 2 * TYPE_SHARES) * 2 / (1 + AXES_SHARE), rel=1e-6)
    assert alike < apart
