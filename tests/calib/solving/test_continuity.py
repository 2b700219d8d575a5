"""A new network goes on with the old one's time, and with nothing else of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.network import Network
from calib.solving.continuity import in_time_of
from tools.doubles.flight import Spec, make

OLD = make(Spec(cameras=4, uavs=1, rate_hz=5.0, duration_s=1.0)).network
NS = 10**9


def retimed(network: Network, shift_s: float, rate: float, later_s: float = 0.0) -> Network:
    """The same network with all clocks moved together, told from another epoch."""
    cameras = tuple(
        replace(
            camera,
            clock_offset_s=camera.clock_offset_s + camera.clock_rate * later_s + shift_s,
            clock_rate=camera.clock_rate + rate,
        )
        for camera in network.cameras
    )
    return replace(network, cameras=cameras, t_mid_unix_ns=network.t_mid_unix_ns + round(later_s * NS))


@given(shift_s=st.floats(-2, 2), rate=st.floats(-1e-3, 1e-3), later_s=st.floats(0, 3000), now_s=st.floats(0, 3000))
def test_the_same_instants_read_the_same_whatever_clock_the_new_one_chose(
    shift_s: float, rate: float, later_s: float, now_s: float
) -> None:
    at_ns = OLD.t_mid_unix_ns + round(now_s * NS)
    found = in_time_of(retimed(OLD, shift_s, rate, later_s), OLD, at_ns)
    for stamp_ns in (at_ns, at_ns + 60 * NS):  # the old clocks run evenly: so do the new ones
        for camera, before in zip(found.cameras, OLD.cameras, strict=True):
            stamps, rows = np.array([stamp_ns]), np.array([100.0])
            new_s = camera.site_time_s(stamps, rows, found.t_mid_unix_ns) + (found.t_mid_unix_ns - stamp_ns) * 1e-9
            old_s = before.site_time_s(stamps, rows, OLD.t_mid_unix_ns) + (OLD.t_mid_unix_ns - stamp_ns) * 1e-9
            assert new_s[0] == pytest.approx(old_s[0], abs=1e-6)  # a double of 3000 s and the epochs' rounding


def test_one_camera_whose_clock_was_set_does_not_drag_the_others_along() -> None:
    cameras = (replace(OLD.cameras[0], clock_offset_s=0.4), *OLD.cameras[1:])
    found = in_time_of(replace(OLD, cameras=cameras), OLD, OLD.t_mid_unix_ns)
    assert [camera.clock_offset_s for camera in found.cameras] == [0.4, 0.0, 0.0, 0.0]


def test_with_no_camera_in_common_it_is_left_as_it_is() -> None:
    other = replace(OLD, cameras=tuple(replace(camera, id="x" + camera.id) for camera in OLD.cameras))
    assert in_time_of(other, OLD, OLD.t_mid_unix_ns) is other
