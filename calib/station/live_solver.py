"""The calibration's solver as the live station uses it. Loaded only in the solving process: it is slow to import."""

import logging
from pathlib import Path
from typing import Final

import numpy as np

from calib.errors import CalibrationError
from calib.network import Network
from calib.observations import Scene
from calib.solving.solution import Solution
from calib.solving.solve import SolveOptions, solve
from calib.station.core.jobs import Solved
from calib.station.report import write_report
from calib.station.report.grade import claims

log = logging.getLogger(__name__)

OPTIONS: Final = SolveOptions(evidence=True)


class LiveSolver:
    """Solves windows, and writes the report on the last one when the station has accepted it."""

    def __init__(self) -> None:
        self._last: Solution | None = None

    def __call__(self, scene: Scene, start: Network | None) -> Solved:
        """Solve a window. The trajectory stays here, where it is large and in nobody's way. Raises CalibrationError."""
        self._last = solution = _solve(scene, start)
        return _told(solution)

    def report(self, folder: Path) -> None:
        """report.html and report.json on the window solved last. Raises OSError."""
        if self._last is not None:
            folder.mkdir(parents=True, exist_ok=True)
            write_report(self._last, folder)


def _solve(scene: Scene, start: Network | None) -> Solution:
    """From the network in force, and if that leads nowhere from nothing: what it was found from may have been poor."""
    if start is not None:
        try:
            return solve(scene, OPTIONS, start)
        except CalibrationError as error:
            log.info("not from the network in force (%s): from nothing", error.what)
    return solve(scene, OPTIONS)


def _told(solution: Solution) -> Solved:
    """Graded by what is claimed alone. That one camera is loose, because its survey is disbelieved, is in the sigma of
    every position that it takes part in; and that has a bound of its own.
    """
    decisive = claims(solution.report.strain, solution.report.findings)
    spread = np.linalg.eigvalsh(solution.trajectory.covariance_enu)[:, -1]
    return Solved(
        solution.network,
        float(np.sqrt(np.median(spread))),
        solution.report.left_out,
        tuple(map(str, solution.report.findings)),
        decisive.grade,
        decisive.reason,
        decisive.action,
    )


solve_live = LiveSolver()
