"""Where two rays come nearest: the point, the gap, and the crossing that is too flat to tell."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.geometry.rays import LEAST_SINE2, nearest_point

coordinate = st.floats(-100.0, 100.0)


def unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))


@given(x=coordinate, y=coordinate, z=st.floats(5.0, 100.0), gap_m=st.floats(0.0, 1.0))
def test_rays_that_miss_a_point_by_half_a_gap_are_nearest_there(x: float, y: float, z: float, gap_m: float) -> None:
    point, a, b = np.array([x, y, z]), np.array([-60.0, -10.0, 0.0]), np.array([55.0, 20.0, 3.0])
    across = np.cross(point - a, point - b)
    if np.linalg.norm(across) < 100.0:  # the point lies on the line through both cameras: no crossing
        return
    off = unit(across) * gap_m / 2
    near = nearest_point(a + off, unit(point - a), b - off, unit(point - b))
    # Ranges of 200 m at a sine of 0.01 magnify rounding by 1e4: 1e-9 m is far above that.
    np.testing.assert_allclose(near.points, point, atol=1e-8)
    assert near.gap_m == pytest.approx(gap_m, abs=1e-8)
    assert near.range_a_m == pytest.approx(np.linalg.norm(point - a), abs=1e-8)
    assert near.range_b_m == pytest.approx(np.linalg.norm(point - b), abs=1e-8)


def test_a_point_behind_a_camera_has_a_negative_range_and_parallel_rays_no_angle() -> None:
    a, b = np.zeros(3), np.array([10.0, 0.0, 0.0])
    behind = nearest_point(a, unit(np.array([-1.0, -1.0, 0.0])), b, unit(np.array([1.0, -1.0, 0.0])))
    assert behind.range_a_m < 0
    assert behind.range_b_m < 0
    ahead = np.array([0.0, 1.0, 0.0])
    assert nearest_point(a, ahead, b, ahead).sine2 < LEAST_SINE2
