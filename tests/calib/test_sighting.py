"""What a camera should see of a point, and the derivatives of it."""

import numpy as np

from calib.sighting import CameraView
from tools.doubles.flight import Spec, make, perturbed

SPEC = Spec(cameras=4, uavs=2, rate_hz=15.0, duration_s=6.0)


def test_derivatives_of_a_sighting_are_those_of_finite_differences() -> None:
    camera, step = make(SPEC).truth[0], 1e-6
    points = np.array([[3.0, 2.0, 40.0], [-20.0, 15.0, 60.0]])
    seen = CameraView.of(camera).sight(points)
    np.testing.assert_allclose(seen.pixels, camera.project(points), atol=1e-9)
    for k in range(3):
        moved = CameraView.of(camera).sight(points + np.eye(3)[k] * step).pixels
        np.testing.assert_allclose((moved - seen.pixels) / step, seen.by_point[:, :, k], rtol=1e-4, atol=1e-4)
    for k in range(6):
        moved = CameraView.of(perturbed(camera, np.eye(6)[k] * step)).sight(points).pixels
        np.testing.assert_allclose((moved - seen.pixels) / step, seen.by_pose[:, :, k], rtol=1e-3, atol=2e-3)


def test_points_behind_a_camera_are_never_valid() -> None:
    camera = make(SPEC).truth[0]
    behind = camera.centre_enu - camera.R_cam_enu[2] * np.array([[10.0], [100.0]])
    assert not CameraView.of(camera).sight(behind).valid.any()
