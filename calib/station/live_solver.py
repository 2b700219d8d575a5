"""The calibration's solver as the live station uses it. Loaded only in the solving process: it is slow to import."""

import numpy as np

from calib.network import Network
from calib.observations import Scene
from calib.solve import solve
from calib.station.worker import Noise, Solved


def solve_live(scene: Scene, start: Network | None) -> Solved:
    """Solve a window. The trajectory stays here, where it is large and in nobody's way. Raises CalibrationError."""
    solution = solve(scene, start=start)
    spread = np.linalg.eigvalsh(solution.trajectory.covariance_enu)[:, -1]
    return Solved(
        solution.network,
        float(np.sqrt(np.median(spread))),
        {camera.id: Noise(camera.sigma_px, camera.correlated_s) for camera in solution.report.cameras},
        solution.report.left_out,
        solution.report.findings,
    )
