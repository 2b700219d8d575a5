"""Solving live: from the network in force, and from nothing where that one leads nowhere."""

from dataclasses import replace

import numpy as np

from calib.network import Network
from calib.simulation.simulation import simulate
from calib.station.core.calibration import NOT_TAKEN
from calib.station.live_solver import LiveSolver
from tests.calib.flights import site
from tools.doubles.hazards.kinds import draw

SIMULATED = simulate(site())


def centre_errors_m(network: Network) -> list[float]:
    true = {camera.id: camera for camera in SIMULATED.network.cameras}
    return [float(np.linalg.norm(camera.centre_enu - true[camera.id].centre_enu)) for camera in network.cameras]


def test_a_network_in_force_that_is_nonsense_does_not_stand_in_the_way() -> None:
    """Every camera turned about: nothing it saw lies ahead of it, and no adjustment leads from there to the truth."""
    about = np.diag([-1.0, 1.0, -1.0])
    cameras = tuple(replace(camera, R_cam_enu=about @ camera.R_cam_enu) for camera in SIMULATED.network.cameras)
    solved = LiveSolver()(SIMULATED.scene, replace(SIMULATED.network, cameras=cameras))
    assert len(solved.network.cameras) == len(SIMULATED.network.cameras)
    assert max(centre_errors_m(solved.network)) < 0.2


def test_what_the_pixels_are_good_for_goes_with_the_network() -> None:
    solved = LiveSolver()(SIMULATED.scene, None)
    assert all(camera.sigma_px is not None and 0.1 < camera.sigma_px < 3 for camera in solved.network.cameras)


def test_a_camera_whose_survey_is_disbelieved_may_be_loose_and_the_network_good() -> None:
    """One of four positions is ten metres off. Its camera is named, and then known from the flight alone: to half a
    metre, which its rays carry with them.
    """
    simulated = draw("mistyped_one", "choose", 0, 21).simulated
    solved = LiveSolver()(simulated.scene, None)
    network = solved.network
    loose_m = max(
        float(np.sqrt(np.linalg.eigvalsh(network.pose_covariance(one.id)[3:, 3:])[-1])) for one in network.cameras
    )
    assert loose_m > 0.4, "else nothing was on trial"
    assert solved.sigma_m < 0.5
    assert solved.grade < NOT_TAKEN, solved.verdict
    true = {camera.id: camera.centre_enu for camera in simulated.network.cameras}
    for camera in network.cameras:
        off = camera.centre_enu - true[camera.id]
        # Beyond 4 sigma lies one in 2000, with three degrees of freedom.
        assert off @ np.linalg.solve(network.pose_covariance(camera.id)[3:, 3:], off) < 16 + 3
