"""Up: a world on its feet stays there whatever its heading; turned over, mirrored or seen from below it does not."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from calib.geometry.rotation import rotation
from calib.solving.upright import DECIDES, upside_down
from edge.common.arrays import Array

CENTRES = np.array([[-60.0, -50.0, 1.0], [70.0, -45.0, 2.0], [5.0, 80.0, 0.0], [-70.0, 60.0, 3.0]])
FLOWN = np.array([[0.0, 0.0, 40.0], [20.0, -10.0, 60.0], [-15.0, 25.0, 30.0]])


def looking_at(centre: Array, target: Array) -> Array:
    """R_cam_enu of a level camera that looks from one place to another."""
    ahead = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(ahead, right), ahead])


def attitudes(centres: Array = CENTRES, target: Array = FLOWN[0]) -> list[Array]:
    return [looking_at(centre, target) for centre in centres]


def turned_over() -> Array:
    """Half a turn about east: what exchanged tripods do to the world."""
    return np.diag([1.0, -1.0, -1.0])


@given(heading=st.floats(-np.pi, np.pi), tilt=st.floats(-0.2, 0.2))
def test_a_world_on_its_feet_is_left_there(heading: float, tilt: float) -> None:
    turn = rotation([tilt, 0.0, 0.0]) @ rotation([0.0, 0.0, heading])
    assert not upside_down([R @ turn.T for R in attitudes()], CENTRES @ turn.T, FLOWN @ turn.T)


@given(heading=st.floats(-np.pi, np.pi))
def test_turned_over_it_is_seen(heading: float) -> None:
    turn = rotation([0.0, 0.0, heading]) @ turned_over()
    assert upside_down([R @ turn.T for R in attitudes()], CENTRES @ turn.T, FLOWN @ turn.T)


def test_one_camera_may_hang_among_others_that_stand() -> None:
    hanging = np.diag([-1.0, -1.0, 1.0])  # half a turn about where it looks
    R = attitudes()
    assert not upside_down([hanging @ R[0], *R[1:]], CENTRES, FLOWN)
    assert upside_down([*(hanging @ one for one in R[:3]), R[3]], CENTRES, FLOWN)


def test_cameras_that_look_straight_up_have_no_say() -> None:
    """Down in their pictures is level: they decide neither way, and what was flown decides."""
    up = np.eye(3)
    assert abs(up[1, 2]) < DECIDES
    assert not upside_down([up] * 4, CENTRES, FLOWN)
    assert upside_down([up] * 4, CENTRES, FLOWN * [1.0, 1.0, -1.0])


def test_what_flies_under_the_lowest_camera_is_under_the_ground_but_for_a_dip() -> None:
    below = FLOWN * [1.0, 1.0, 0.0] - [0.0, 0.0, 5.0]
    level = attitudes(target=np.array([0.0, 0.0, 1.0]))
    assert upside_down(level, CENTRES, below)
    assert not upside_down(level, CENTRES, np.concatenate([FLOWN, np.tile(below, (5, 1))]))


def test_without_a_flight_the_cameras_decide() -> None:
    assert not upside_down(attitudes(), CENTRES, FLOWN[:0])
    assert upside_down([np.diag([-1.0, -1.0, 1.0]) @ R for R in attitudes()], CENTRES, FLOWN[:0])
