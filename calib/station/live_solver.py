"""The calibration's solver as the live station uses it. Loaded only in the solving process: it is slow to import."""

from pathlib import Path

import numpy as np

from calib.network import Network
from calib.observations import Scene
from calib.solution import Solution
from calib.solve import SolveOptions, solve
from calib.station.report import write_report
from calib.station.worker import Noise, Solved


class LiveSolver:
    """Solves windows, and writes the report on the last one when the station has accepted it."""

    def __init__(self) -> None:
        self._last: Solution | None = None

    def __call__(self, scene: Scene, start: Network | None) -> Solved:
        """Solve a window. The trajectory stays here, where it is large and in nobody's way. Raises CalibrationError."""
        self._last = solution = solve(scene, SolveOptions(evidence=True), start)
        return _told(solution)

    def report(self, folder: Path) -> None:
        """report.html and report.json on the window solved last. Raises OSError."""
        if self._last is not None:
            folder.mkdir(parents=True, exist_ok=True)
            write_report(self._last, folder)


def _told(solution: Solution) -> Solved:
    spread = np.linalg.eigvalsh(solution.trajectory.covariance_enu)[:, -1]
    return Solved(
        solution.network,
        float(np.sqrt(np.median(spread))),
        {camera.id: Noise(camera.sigma_px, camera.correlated_s) for camera in solution.report.cameras},
        solution.report.left_out,
        solution.report.findings,
    )


solve_live = LiveSolver()
