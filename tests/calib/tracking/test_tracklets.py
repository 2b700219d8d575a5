"""Short tracks of one camera: long, fresh and straight enough, or none."""

import numpy as np
import pytest

from calib.tracking.searches import STRAIGHT, TURNING
from calib.tracking.tracklets import FRESH, LooseRay, tracklets
from tools.doubles.flight import Spec, make

SCENE = make(Spec(cameras=2, uavs=1, duration_s=0.1, sigma_attitude_rad=0.0, sigma_centre_m=0.0))


def rays(u_px: np.ndarray, t_s: np.ndarray, label: int = 7) -> list[LooseRay]:
    return [LooseRay(1, label, float(t), float(u), 500.0, 1.0) for u, t in zip(u_px, t_s, strict=True)]


T_S = np.arange(6) / 15


def test_a_straight_track_is_one_and_its_bearing_is_the_cameras() -> None:
    (found,) = tracklets(rays(900 + 60 * T_S, T_S), SCENE.network, STRAIGHT, T_S[-1])
    assert (found.camera, found.label) == (1, 7)
    bearing = SCENE.network.cameras[1].bearings_enu(np.array([[900 + 60 * T_S[3], 500.0]]))[0]
    # A straight line in bearings against one in pixels: 60 px at f = 1300 bend by less than 1e-4.
    np.testing.assert_allclose(found.at(float(T_S[3])), bearing, atol=1e-4)
    assert found.sigma_rad == pytest.approx(1 / 1300)


def test_too_few_too_short_too_old_and_bent_ones_are_none() -> None:
    straight = 900 + 60 * T_S
    assert tracklets(rays(straight, T_S)[:2], SCENE.network, STRAIGHT, T_S[1]) == []
    assert tracklets(rays(straight, T_S / 10), SCENE.network, STRAIGHT, T_S[-1] / 10) == []
    assert tracklets(rays(straight, T_S), SCENE.network, STRAIGHT, T_S[-1] + FRESH * STRAIGHT.span_s + 0.01) == []
    jumping = straight + np.where(np.arange(6) % 2, 60.0, 0.0)  # a number given to two objects in turn
    assert tracklets(rays(jumping, T_S), SCENE.network, STRAIGHT, T_S[-1]) == []


def test_a_turn_is_no_straight_track_and_one_of_a_hard_turn() -> None:
    """40 m/s on a circle of 30 m, 45 m away: 1.2 rad/s^2 in the picture."""
    turning = 900 + 1300 * 1.2 / 2 * T_S**2 * 4
    assert tracklets(rays(turning, T_S), SCENE.network, STRAIGHT, T_S[-1]) == []
    (found,) = tracklets(rays(turning, T_S), SCENE.network, TURNING, T_S[-1])
    bearing = SCENE.network.cameras[1].bearings_enu(np.array([[turning[3], 500.0]]))[0]
    np.testing.assert_allclose(found.at(float(T_S[3])), bearing, atol=2e-3)
