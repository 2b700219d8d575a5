"""Every derivative of a pixel, the fourteen of the camera and the three of the point, against finite differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.adjustment.priors import moved
from calib.adjustment.projection import CAMERA_SIZE, LENS, OFFSET, RATE, READOUT, CameraData, Projected, project
from calib.geometry.rotation import rotation
from calib.geometry.spline import Flight, evaluate
from calib.network import Camera
from edge.lens import LensModel

LENSES = {
    "radtan": LensModel("radtan", (1000.0, 1010.0, 960.0, 540.0), (-0.2, 0.05, 1e-3, -5e-4, 0.01), (1920, 1080)),
    "fisheye": LensModel("fisheye", (700.0, 705.0, 960.0, 540.0), (0.02, -0.004, 0.001, 0.0), (1920, 1080)),
}
FLIGHT = Flight(np.array([-5.0]), np.array([20]), 0.5, np.array([0]))
# Steps that change a pixel by about 1e-3: central differences are then good to about 1e-7 of the derivative.
STEPS = np.array([1e-6] * 3 + [1e-4] * 3 + [1e-5, 1e-5, 1e-5] + [1e-3] * 4 + [1e-6])
NAMES = ["rx", "ry", "rz", "e", "n", "u", "offset", "rate", "readout", "fx", "fy", "cx", "cy", "k1"]


def camera(kind: str) -> Camera:
    R = rotation([0.1, -0.2, 0.3]) @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    return Camera("cam", LENSES[kind], R, np.array([3.0, -80.0, 2.0]), 0.05, 1e-4, 0.02)


def control() -> np.ndarray:
    rng = np.random.default_rng(2)
    return np.cumsum(rng.normal(0, 1.5, (FLIGHT.controls, 3)), axis=0) + np.array([0.0, 20.0, 10.0])


def data(count: int = 25) -> CameraData:
    # Away from knots, where the velocity's slope jumps and a difference across it is no derivative of anything.
    pieces = np.arange(count) % 19
    t = -5.0 + 0.5 * pieces + 0.15 + 0.01 * (np.arange(count) % 10) - 0.06
    pixels = np.random.default_rng(3).uniform(100, 900, (count, 2))
    return CameraData(t, pixels, np.zeros(count, np.int64), np.ones(count))


def residual(camera: Camera, points: np.ndarray) -> Projected:
    return project(camera, data(), FLIGHT, points)


@pytest.mark.parametrize("kind", LENSES)
@pytest.mark.parametrize("column", range(CAMERA_SIZE), ids=NAMES)
def test_by_camera(kind: str, column: int) -> None:
    at = residual(camera(kind), control())
    assert at.valid.all()
    step = np.eye(CAMERA_SIZE)[column] * STEPS[column]
    ahead, behind = (residual(moved(camera(kind), sign * step), control()).residual for sign in (1, -1))
    slope = (ahead - behind) / (2 * STEPS[column])
    scale = np.abs(slope).max()
    assert scale > 0
    assert np.abs(at.by_camera[:, :, column] - slope).max() < 1e-6 * scale + 1e-9 / STEPS[column]


@pytest.mark.parametrize("kind", LENSES)
@pytest.mark.parametrize("axis", range(3))
def test_by_point_through_every_control_point(kind: str, axis: int) -> None:
    at, points, step = residual(camera(kind), control()), control(), 1e-4
    weights = at.located.weights()
    for which in range(FLIGHT.controls):
        shift = np.zeros_like(points)
        shift[which, axis] = step
        ahead, behind = (residual(camera(kind), points + sign * shift).residual for sign in (1, -1))
        slope = (ahead - behind) / (2 * step)
        acting = np.where(at.located.controls() == which, weights, 0.0).sum(1)
        assert np.abs(at.by_point[:, :, axis] * acting[:, None] - slope).max() < 1e-5


@given(offset=st.floats(-0.2, 0.2), readout=st.floats(0, 0.03), rate=st.floats(-1e-3, 1e-3))
def test_clock_columns_are_one_velocity(offset: float, readout: float, rate: float) -> None:
    """Offset, rate and readout all move the object along its path: their columns differ by a known factor a row."""
    turned = camera("radtan")
    turned = Camera("cam", turned.lens, turned.R_cam_enu, turned.centre_enu, offset, rate, readout)
    at, seen = residual(turned, control()).by_camera, data()
    assert at[:, :, RATE] == pytest.approx(at[:, :, OFFSET] * seen.t_s[:, None])
    assert at[:, :, READOUT] == pytest.approx(at[:, :, OFFSET] * seen.pixels[:, 1:] / 1080)


def test_a_point_behind_or_outside_a_stretch_is_set_aside() -> None:
    behind = project(camera("radtan"), data(), FLIGHT, control() - [0.0, 500.0, 0.0])
    assert not behind.valid.any()
    assert np.isfinite(behind.residual).all()
    assert np.isfinite(behind.by_camera[:, :, LENS]).all()
    unflown = CameraData(np.array([99.0]), np.zeros((1, 2)), np.zeros(1, np.int64), np.ones(1))
    assert not project(camera("radtan"), unflown, FLIGHT, control()).valid.any()


@pytest.mark.parametrize("kind", LENSES)
def test_the_residual_is_what_the_network_projects(kind: str) -> None:
    seen, at = data(), residual(camera(kind), control())
    pixels = camera(kind).project(evaluate(at.located, control()))
    assert at.residual == pytest.approx(pixels - seen.pixels, abs=1e-9)
