"""Cameras in a line, or two: the roll about the line is open, and only an up-direction closes it."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import CalibrationError
from calib.geometry.rotation import rotation
from calib.observations import Scene
from calib.simulation.simulation import Simulated
from tests.calib.flights import site
from tests.synthetic.solving import assert_right, solved

LINE = {f"cam{k + 1}": {"centre_enu": (-60.0 + 40.0 * k, -70.0, 1.0)} for k in range(4)}
UP_SIGMA_DEG = 0.5


def with_level(simulated: Simulated) -> Scene:
    """The scene with a level on the first camera, off by about its sigma."""
    first = simulated.network.cameras[0]
    off = np.radians(UP_SIGMA_DEG) * np.random.default_rng(0).normal(size=3)
    up = rotation(off) @ first.R_cam_enu[:, 2]
    cameras = tuple(
        replace(camera, up_cam=up, up_sigma_deg=UP_SIGMA_DEG) if camera.id == first.id else camera
        for camera in simulated.scene.cameras
    )
    return replace(simulated.scene, cameras=cameras)


def test_a_line_is_refused_with_what_would_help() -> None:
    with pytest.raises(CalibrationError, match=r"in a line.*roll.*up_cam"):
        solved(site(offsets_s=(0.0,) * 4, special=LINE))


def test_two_cameras_are_refused_with_what_would_help() -> None:
    with pytest.raises(CalibrationError, match=r"three must.*up_cam"):
        solved(site(offsets_s=(0.0, 0.0)))


def test_a_line_with_a_level_is_solved() -> None:
    found = solved(site(offsets_s=(0.0,) * 4, special=LINE), change=with_level)
    assert len(found.names) == 4
    # Half a degree at 80 m is 0.7 m: the level's own limit, and the solution says so.
    assert 0.3 < found.sigma_m() < 2.0
    assert_right(found)


def test_two_cameras_with_a_level_are_solved() -> None:
    found = solved(site(offsets_s=(0.0, 0.0)), change=with_level)
    assert_right(found)
