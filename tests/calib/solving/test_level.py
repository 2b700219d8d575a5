"""How level pictures are: derivatives against differences, and a leaning world against one that stands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.adjustment.projection import CAMERA_SIZE, ROTATION
from calib.geometry.rotation import rotation
from calib.network import Camera
from calib.observations import SiteCamera
from calib.solving.level import SITES, levels, log_likelihood
from edge.common.arrays import Array
from tests.calib.solving.claims import LENS_MODEL

STEP_RAD = 1e-6
STANDING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # looks north, level


def camera(name: str, R_cam_enu: Array) -> Camera:
    return Camera(name, LENS_MODEL, R_cam_enu, np.zeros(3))


def sites(*names: str, knows_up: bool = False) -> dict[str, SiteCamera]:
    up = np.array([0.0, -1.0, 0.0]) if knows_up else None
    return {name: SiteCamera(name, LENS_MODEL, up_cam=up) for name in names}


@settings(max_examples=50)
@given(turn=st.lists(st.floats(-0.6, 0.6), min_size=3, max_size=3), portrait=st.booleans())
def test_the_derivative_is_that_of_a_small_turn(turn: list[float], portrait: bool) -> None:
    on_its_side = rotation([0.0, 0.0, np.pi / 2]) if portrait else np.eye(3)
    R = on_its_side @ rotation(turn) @ STANDING
    here = levels((camera("a", R),), sites("a"))
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = STEP_RAD
        there = levels((camera("a", rotation(step) @ R),), sites("a"))
        change = (there.value - here.value)[0] / STEP_RAD
        assert here.derivative[0, np.arange(CAMERA_SIZE)[ROTATION]][axis] == pytest.approx(change, abs=1e-4)


@given(roll=st.floats(-0.7, 0.7), portrait=st.booleans(), up_rad=st.floats(-1.2, 1.2))
def test_landscape_and_portrait_are_as_level_as_their_roll(roll: float, portrait: bool, up_rad: float) -> None:
    """Up to 40 degrees, nearer to level than to upright; a level camera is level however high it looks."""
    turned = rotation([0.0, 0.0, roll + (np.pi / 2 if portrait else 0.0)])
    found = levels((camera("a", turned @ STANDING),), sites("a"))
    assert abs(found.value[0]) == pytest.approx(abs(np.sin(roll)), abs=1e-9)
    level = levels((camera("a", rotation([up_rad, 0.0, 0.0]) @ STANDING),), sites("a"))
    assert level.value[0] == pytest.approx(0.0, abs=1e-9)


def test_a_camera_that_knows_up_is_no_witness() -> None:
    assert len(levels((camera("a", STANDING),), sites("a", knows_up=True)).value) == 0


def test_a_site_that_leans_is_less_likely_than_one_that_stands_and_one_that_is_askew_no_more_than_that() -> None:
    """At 23 degrees, what a levelled site would say is nothing against the share of those that are not."""
    standing, leaning = log_likelihood(np.zeros(3)), log_likelihood(np.full(3, 0.15))
    assert standing > leaning
    askew_rad, share = SITES[-1]
    alone = np.log(share) - 3 * np.log(askew_rad * np.sqrt(2 * np.pi)) - 1.5
    assert log_likelihood(np.full(3, askew_rad)) == pytest.approx(alone, abs=1e-6)
