"""What is known beforehand: steps stay cameras, derivatives are derivatives, bounds are believed while they hold."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.adjustment.joint_prior import JointPrior
from calib.adjustment.normal import Normal
from calib.adjustment.priors import FIXED, CameraPrior, camera_priors, held, misled, moved, time_reference
from calib.adjustment.projection import CAMERA_SIZE, LENS, OFFSET, RATE, READOUT, ROTATION
from calib.geometry.rotation import rotation
from calib.network import Camera
from calib.observations import SiteCamera
from edge.lens import LensModel

LENS_MODEL = LensModel("radtan", (1000.0, 1000.0, 960.0, 540.0), (0.0,) * 4, (1920, 1080))


def camera(offset_s: float = 0.0, name: str = "a") -> Camera:
    return Camera(name, LENS_MODEL, rotation([0.3, -1.0, 0.4]), np.array([1.0, 2.0, 3.0]), offset_s, 0.0, 0.01)


def site(name: str = "a", **known: object) -> SiteCamera:
    return SiteCamera(name, LENS_MODEL, np.zeros(3), np.eye(3) * 0.01, **known)  # type: ignore[arg-type]


@given(step=st.lists(st.floats(-2, 2), min_size=14, max_size=14))
def test_a_moved_camera_is_still_a_camera(step: list[float]) -> None:
    after = moved(camera(), np.array(step))
    assert after.R_cam_enu @ after.R_cam_enu.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(after.R_cam_enu) == pytest.approx(1.0)
    assert after.R_cam_enu == pytest.approx(rotation(step[:3]) @ camera().R_cam_enu, abs=1e-12)
    assert after.centre_enu == pytest.approx(camera().centre_enu + step[3:6])
    assert after.lens.intrinsics[0] == pytest.approx(1000 + step[9])


def test_no_step_no_change() -> None:
    after = moved(camera(), np.zeros(CAMERA_SIZE))
    assert after.R_cam_enu == pytest.approx(camera().R_cam_enu, abs=1e-15)
    assert (after.lens, after.clock_offset_s) == (LENS_MODEL, 0.0)


def test_a_thousand_steps_do_not_leave_the_rotations() -> None:
    at = camera()
    for _ in range(1000):
        at = moved(at, np.full(CAMERA_SIZE, 1e-2))
    assert np.abs(at.R_cam_enu @ at.R_cam_enu.T - np.eye(3)).max() < 1e-14


def prior_with_up() -> CameraPrior:
    up = rotation([0.02, -0.01, 0.03]) @ camera().R_cam_enu[:, 2]
    return CameraPrior(camera(), np.full(CAMERA_SIZE, 2.0), np.diag([4.0, 5.0, 6.0]), up, 0.01)


def test_up_residual_and_its_derivative() -> None:
    prior, step = prior_with_up(), 1e-6
    _, by_rotation = prior.up_residual(camera())
    for axis in range(3):
        turn = np.eye(CAMERA_SIZE)[axis] * step
        ahead, behind = (prior.up_residual(moved(camera(), sign * turn))[0] for sign in (1, -1))
        assert by_rotation[:, axis] == pytest.approx((ahead - behind) / (2 * step), abs=1e-5)
    assert np.linalg.norm(prior.up_residual(camera())[0]) == pytest.approx(np.hypot(0.02, 0.03) / 0.01, rel=0.5)


@given(seed=st.integers(0, 10**6))
def test_the_pull_is_the_slope_of_the_cost(seed: int) -> None:
    prior = prior_with_up()
    at = moved(camera(), np.random.default_rng(seed).normal(0, 0.01, CAMERA_SIZE))
    joint, normal = JointPrior((prior,)), Normal.zero(4, CAMERA_SIZE)
    joint.add_to(normal, (at,))
    gradient = -normal.right_camera
    step = 1e-5
    for axis in range(CAMERA_SIZE):
        shift = np.eye(CAMERA_SIZE)[axis] * step
        slope = (joint.cost((moved(at, shift),)) - joint.cost((moved(at, -shift),))) / (2 * step)
        assert slope / 2 == pytest.approx(gradient[axis], abs=1e-3)  # up is worth 1e4 a rad^2: its curvature shows


def test_what_is_fixed_neither_moves_nor_costs() -> None:
    sigma = np.ones(CAMERA_SIZE)
    sigma[[OFFSET, READOUT]] = FIXED
    sigma[ROTATION] = np.inf
    prior = CameraPrior(camera(), sigma, np.zeros((3, 3)))
    away = moved(camera(), np.full(CAMERA_SIZE, 0.1))
    assert prior.fixed.nonzero()[0].tolist() == [OFFSET, READOUT]
    assert prior.deviation(away)[[OFFSET, READOUT]].tolist() == [0.0, 0.0]
    assert held(away, prior).clock_offset_s == camera().clock_offset_s
    assert held(away, prior).clock_rate == away.clock_rate


def priors_of(*pairs: tuple[Camera, SiteCamera]) -> tuple[CameraPrior, ...]:
    cameras, sites = zip(*pairs, strict=True)
    return camera_priors(cameras, {one.id: one for one in sites})


def test_the_clock_with_the_smallest_bound_is_the_sites_time() -> None:
    sites = {"a": site("a", clock_bound_s=0.1), "b": site("b", clock_bound_s=1e-3), "c": site("c")}
    cameras = tuple(camera(0.0, name) for name in sites)
    assert time_reference(cameras, sites) == "b"
    reference = camera_priors(cameras, sites)[1]
    assert reference.fixed[[OFFSET, RATE]].all()


@pytest.mark.parametrize(
    ("offsets_s", "rates", "off"),
    [
        ((0, 0.1, 0.1, 0.1), (0, 0, 0, 0), True),
        ((0, -0.1, -0.1, -0.1), (0, 0, 0, 0), True),
        ((0, 0, 0.1, 0), (0, 0, 0, 0), False),
        ((0, 0, 0, 0), (0, 1e-3, 1e-3, 1e-3), True),
        ((0, 0, 0, 0), (0, 0, 1e-3, 0), False),
        ((0, 0, 0, 0), (0, 2e-4, 2e-4, 2e-4), False),  # a bound of milliseconds is left no faster by a drifting crystal
    ],
)
def test_the_time_and_its_pace_are_what_most_say_that_know_theirs(
    offsets_s: tuple[float, ...], rates: tuple[float, ...], off: bool
) -> None:
    clocks = enumerate(zip(offsets_s, rates, strict=True))
    cameras = tuple(replace(camera(offset_s, f"c{k}"), clock_rate=rate) for k, (offset_s, rate) in clocks)
    sites = {one.id: site(one.id, clock_bound_s=1e-3) for one in cameras}
    assert misled(cameras, sites) is off
    assert not misled(cameras, {name: site(name) for name in sites}), "of those that state nothing nobody knows"


def test_a_bound_is_believed_until_the_tracks_contradict_it() -> None:
    reference = (camera(0.0, "r"), site("r", clock_bound_s=1e-6))
    believed = priors_of(reference, (camera(0.004), site("a", clock_bound_s=0.002)))[1]
    assert (believed.sigma[OFFSET], believed.mean.clock_offset_s) == (0.002, 0.0)
    contradicted = priors_of(reference, (camera(1.5), site("a", clock_bound_s=0.002)))[1]
    assert contradicted.sigma[OFFSET] > 0.1
    silent = priors_of(reference, (camera(1.5), site("a")))[1]
    assert silent.sigma[OFFSET] == contradicted.sigma[OFFSET]


def test_a_global_shutter_has_no_readout_to_find() -> None:
    reference = (camera(0.0, "r"), site("r", clock_bound_s=0.0))
    assert priors_of(reference, (camera(), site(readout_s=0.0)))[1].fixed[READOUT]
    assert not priors_of(reference, (camera(), site(readout_s=0.02)))[1].fixed[READOUT]
    assert not priors_of(reference, (camera(), site()))[1].fixed[READOUT]


def test_the_lens_report_tightens_the_lens() -> None:
    sure = replace(site("b"), lens=replace(LENS_MODEL, focal_sigma_px=0.5))
    usual, tight = priors_of((camera(), site()), (replace(camera(0.0, "b"), lens=sure.lens), sure))
    assert tight.sigma[LENS.start] == 0.5
    assert usual.sigma[LENS.start] == pytest.approx(10.0)
