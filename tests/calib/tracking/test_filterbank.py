"""The Kalman filters: covariances that stay covariances, and grow where nobody measures."""

from dataclasses import replace

import numpy as np
import pytest

from calib.geometry.rotation import rotation
from calib.sighting import CameraView
from calib.tracking.filterbank import FilterBank, Look, Rays
from calib.tracking.motion import Singer
from tools.doubles.flight import Spec, make

SPEC = Spec(cameras=4, uavs=2, rate_hz=15.0, duration_s=6.0)


def test_a_filter_that_only_predicts_stays_a_covariance() -> None:
    scene = make(SPEC)
    bank = FilterBank(scene.network, Singer())
    bank.add(np.r_[0, 0, 50, 3, 0, 0, 0, 0, 0].astype(float), np.eye(9), np.zeros((9, 24)), 0.0)
    view = CameraView.of(scene.network.cameras[0])
    for k in range(1, 200):
        prediction = bank.predict(k / 30)
        seen = view.sight(prediction.state[:, :3])
        rays = Rays(seen.pixels + 0.3, np.zeros(1), np.ones(1))
        bank.update(prediction, np.array([0]), Look(0, view, seen, rays))
    values = np.linalg.eigvalsh(bank.covariance[0])
    assert values[0] > 0
    np.testing.assert_allclose(bank.covariance[0], bank.covariance[0].T)
    assert np.linalg.det(rotation(np.array([0.1, 0.2, 0.3]))) == pytest.approx(1.0)


def test_the_second_camera_that_finds_a_target_again_tells_where_it_is_and_how_surely() -> None:
    """One camera alone leaves the range open; a tangent at a range metres off would end in a sure and false place."""
    scene = make(replace(SPEC, sigma_attitude_rad=0.0, sigma_centre_m=0.0))
    cameras, mahalanobis2s = scene.network.cameras, []
    rng = np.random.default_rng(7)
    for _ in range(100):
        truth = np.array([*rng.uniform(-20, 20, 2), rng.uniform(20, 40)])
        ahead = truth - cameras[0].centre_enu
        along = ahead / np.linalg.norm(ahead)
        bank = FilterBank(scene.network, Singer())
        P = np.diag([0.05**2] * 3 + [1.0] * 3 + [4.0] * 3)
        P[:3, :3] += 15.0**2 * np.outer(along, along)  # m: half a second of range unseen costs metres, two dozens
        off = rng.multivariate_normal(np.zeros(9), P, method="cholesky")
        bank.add(np.r_[truth, np.zeros(6)] + off, P, np.zeros((9, 24)), 0.0)
        prediction, view = bank.predict(0.0), CameraView.of(cameras[1])
        pixel = cameras[1].project(truth[None]) + rng.normal(0, 0.5, (1, 2))
        rays = Rays(pixel, np.zeros(1), np.full(1, 0.5))
        bank.update(prediction, np.array([0]), Look(1, view, view.sight(prediction.state[:, :3]), rays))
        miss = bank.state[0, :3] - truth
        mahalanobis2s.append(float(miss @ np.linalg.solve(bank.covariance[0, :3, :3], miss)))
    # 3 expected; the mean of 100 lies below 3.8 in 999 of 1000 cases, and what is left of the bend costs a little.
    assert np.mean(mahalanobis2s) < 4.5


def test_a_calm_flight_is_not_believed_to_stay_calm_where_nobody_measures_its_range() -> None:
    scene = make(SPEC)
    bank = FilterBank(scene.network, Singer())
    bank.add(np.r_[0, 0, 50, 3, 0, 0, 0, 0, 0].astype(float), np.eye(9) * 1e-4, np.zeros((9, 24)), 0.0)
    bank.manoeuvre_factor[:] = 0.02
    spread_m = []
    for watched in (True, False):
        bank.watched[:] = watched
        spread_m.append(float(np.sqrt(np.trace(bank.predict(2.0).covariance[0, :3, :3]))))
    assert spread_m[1] == pytest.approx(spread_m[0] / np.sqrt(0.02), rel=0.05)


def test_a_target_that_one_camera_alone_goes_on_seeing_may_already_be_turning() -> None:
    scene = make(SPEC)
    bank = FilterBank(scene.network, Singer())
    for manoeuvre_factor in (0.02, 4.0):
        bank.add(np.r_[0, 0, 50, 3, 0, 0, 0, 0, 0].astype(float), np.eye(9) * 1e-4, np.zeros((9, 24)), 0.0)
        bank.manoeuvre_factor[-1] = manoeuvre_factor
    bank.watch(np.array([1, 1]))
    once = bank.covariance.copy()
    bank.watch(np.array([1, 1]))
    np.testing.assert_array_equal(bank.covariance, once)
    unseen = replace(bank, covariance=np.stack([np.eye(9) * 1e-4] * 2))
    unseen.watch(np.array([0, 0]))
    assert unseen.covariance[0, 8, 8] == 1e-4, "one that nobody sees coasts, and is soon lost anyway"
    calm, wild = once[:, 8, 8]
    assert calm == pytest.approx(Singer().sigma_m_s2 ** 2 * 0.98, rel=1e-3)
    assert wild == 1e-4
