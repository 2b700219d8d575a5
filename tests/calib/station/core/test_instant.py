"""A Targets message gives all targets at one instant: where they are then, however old their last measurements are."""

import numpy as np
import pytest

from calib.geodesy import ecef_to_enu
from calib.station.core.outgoing import UPPER
from tests.calib.station.conftest import Fed, station_for
from tools.doubles.box_messages import messages
from tools.doubles.flight import ORIGIN, Spec, make

NS = 10**9
CHI2_3_999 = 16.27  # squared error in units of its covariance, three degrees of freedom
SPEC = Spec(cameras=4, uavs=2, rate_hz=15.0, duration_s=14.0)


@pytest.mark.parametrize("behind_s", [0.0, 0.3])
def test_targets_are_where_they_say_at_the_instant_they_name(behind_s: float) -> None:
    """behind_s: how long ago the newest frame came. A target at 8 m/s has by then flown 2.4 m: 50 of its sigmas."""
    scene = make(SPEC)
    fed = Fed(station_for(scene), scene)
    nees, flown_m = [], []
    for sent in messages(scene):
        fed.take(sent)
        message = fed.station.targets(fed.station.now_unix_ns(sent.arrival_ns) + round(behind_s * NS))
        for target in message.targets if message is not None else ():
            assert message is not None
            there = scene.positions(message.t_unix_ns)
            error = there - ecef_to_enu(np.array([target.ecef_m]), ORIGIN)[0]
            nearest = error[np.argmin(np.linalg.norm(error, axis=1))]
            whole = np.zeros((6, 6))
            whole[UPPER] = target.covariance
            # Turning from ECEF to ENU keeps the eigenvalues: the largest bounds what is claimed in any direction.
            claimed = np.linalg.eigvalsh(whole[:3, :3] + np.triu(whole[:3, :3], 1).T)[-1]
            nees.append(nearest @ nearest / claimed)
            flown_m.append(np.linalg.norm(target.velocity_m_s) * behind_s)
    assert len(nees) > 500
    assert np.median(flown_m) >= behind_s
    assert np.mean(np.array(nees) < CHI2_3_999) > 0.98
