"""Solve a simulated site and compare with its truth."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.observations import Scene
from calib.simulation.description import Simulation
from calib.simulation.simulation import Simulated, simulate
from calib.solving.solution import Solution
from calib.solving.solve import SolveOptions, solve

# Errors that a flight shares (attitudes, lenses) make one draw of few numbers: four of their sigmas are never reached
# by chance in some hundred tests, and a wrong basin is off by tens of them.
SIGMAS = 4.0


@dataclass(frozen=True)
class Solved:
    """A solution beside the truth it was drawn from."""

    solution: Solution
    truth: Simulated

    def error_m(self, track: int = 0, number: int = 1) -> np.ndarray:
        """(N, 3) estimate minus truth along a track, where the object flew."""
        trajectory = self.solution.trajectory
        own = trajectory.track == track
        off = trajectory.points_enu[own] - self.truth.truth_enu(trajectory.t_unix_ns[own], number)
        return off[np.isfinite(off[:, 0])]

    def rmse_m(self, track: int = 0, number: int = 1) -> float:
        return float(np.sqrt((self.error_m(track, number) ** 2).sum(1).mean()))

    def sigma_m(self, track: int = 0) -> float:
        """What the solution says its RMSE is."""
        trajectory = self.solution.trajectory
        return float(np.sqrt(np.trace(trajectory.covariance_enu[trajectory.track == track], axis1=1, axis2=2).mean()))

    def turned_rad(self, name: str) -> float:
        """How far a camera's attitude is from the truth."""
        found, true = self.solution.network.camera(name), self.truth.network.camera(name)
        assert found is not None
        assert true is not None
        return float(np.arccos(np.clip((np.trace(found.R_cam_enu @ true.R_cam_enu.T) - 1) / 2, -1, 1)))

    @property
    def names(self) -> list[str]:
        return [camera.id for camera in self.solution.network.cameras]


def solved(
    description: Simulation, *, trial: int = 0, local: bool = False, change: Callable[[Simulated], Scene] | None = None
) -> Solved:
    """Simulate one trial of a site and solve it."""
    truth = simulate(description, trial)
    scene = change(truth) if change else truth.scene
    return Solved(solve(scene, SolveOptions(local=local)), truth)


def assert_right(found: Solved, track: int = 0, number: int = 1) -> None:
    """The flight is where it was, within what the solution claims to know."""
    assert len(found.error_m(track, number)) > 100
    assert found.rmse_m(track, number) < SIGMAS * found.sigma_m(track)
