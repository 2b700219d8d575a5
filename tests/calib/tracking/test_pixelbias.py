"""What lasts in a camera's pixels is pointing; what is gone in a frame is noise."""

from dataclasses import replace

import numpy as np
import pytest

from calib.network import POSE_SIZE
from calib.tracking.pixelbias import bias_rad, with_bias
from tools.doubles.flight import Spec, make

NETWORK = make(Spec(cameras=3, uavs=1, rate_hz=5.0, duration_s=1.0)).network


@pytest.mark.parametrize(("correlated_s", "share"), [(0.033, 0.0), (0.35, 0.25), (1.1, 1.0), (20.0, 1.0)])
def test_the_share_of_the_variance_that_outlives_the_filters_memory(correlated_s: float, share: float) -> None:
    camera = replace(NETWORK.cameras[0], sigma_px=0.8, correlated_s=correlated_s)
    focal = min(camera.lens.intrinsics[:2])
    assert bias_rad(camera) ** 2 == pytest.approx(share * (0.8 / focal) ** 2)


def test_only_turns_that_move_a_pixel_become_less_certain_and_each_camera_for_itself() -> None:
    cameras = (replace(NETWORK.cameras[0], sigma_px=0.8, correlated_s=3.0), *NETWORK.cameras[1:])
    added = with_bias(replace(NETWORK, cameras=cameras)).covariance - NETWORK.covariance
    expected = np.zeros(POSE_SIZE * 3)
    expected[:2] = bias_rad(cameras[0]) ** 2
    np.testing.assert_allclose(added, np.diag(expected), atol=1e-15)
