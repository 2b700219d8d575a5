"""Solving live: from the network in force, and from nothing where that one leads nowhere."""

from dataclasses import replace

import numpy as np

from calib.network import Network
from calib.simulation.simulation import simulate
from calib.station.live_solver import LiveSolver
from tests.calib.flights import site

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
