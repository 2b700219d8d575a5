"""Cameras that contradict each other: none is used, and all are calibrated again from what is seen since."""

import numpy as np

from calib.observations import Frame, SiteCamera
from calib.station.config import CalibrationSection
from calib.station.core.calibration import Calibration, Phase
from calib.station.core.window import Window
from tools.doubles.box_messages import SITE
from tools.doubles.flight import ORIGIN, T0_UNIX_NS, Spec, make

NS = 10**9
NAMES = ["cam0", "cam1", "cam2"]


def test_nothing_is_trusted_until_a_network_of_rows_since_is_taken() -> None:
    scene = make(Spec(cameras=3, uavs=1, duration_s=1.0))
    sites = {c.id: SiteCamera(c.id, c.lens, c.centre_enu, 1e-4 * np.eye(3), 0.001) for c in scene.truth}
    calibration, window = Calibration(CalibrationSection(first_solve_s=3.0), NAMES, SITE), Window(NAMES)
    calibration.network = scene.network
    assert calibration.trusted == set(NAMES)
    calibration.contradict("these cameras disagree: cam0, cam1, cam2")
    assert calibration.trusted == set()
    assert not calibration.trusts("cam0")
    standing = calibration.standing(window, sites, busy=False)
    assert standing.phase is Phase.SUSPECT
    assert standing.reason.startswith("no position is sent: these cameras disagree: cam0, cam1, cam2; waiting for")
    assert calibration.plan(window, sites, ORIGIN, T0_UNIX_NS) is None, "nothing was seen since"
    for second in range(5):
        for name in NAMES:
            window.add(Frame(name, T0_UNIX_NS + second * NS, np.ones((1, 2)), np.ones(1, int), np.ones(1)))
    job = calibration.plan(window, sites, ORIGIN, T0_UNIX_NS + 5 * NS)
    assert job is not None
    assert job.start is None, "which camera is wrong is not known: nothing to begin with"
    calibration.drop("the network as a whole is not believed")
    assert calibration.contradiction == ""
