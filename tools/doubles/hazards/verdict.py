"""An answer held against the truth, without any alignment: how far off, how honest, and who was blamed for it.

A row is beyond its sigma when its squared Mahalanobis distance, with the row's own 3 x 3 covariance, is more than that
quantile of chi-square with three degrees of freedom that a normal error exceeds at four sigmas (6.3 in 100 000). With
several objects in the air the nearest one counts. A trajectory is confidently wrong when more than 1 % of its rows are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calib.geodesy import Origin, R_ecef_enu, ecef_to_enu, enu_to_ecef
from calib.simulation.simulation import Simulated
from calib.solving.solution import Solution
from edge.common.arrays import Array
from tools.doubles.hazards.brought import Brought

SIGMAS: Final = 4.0
BEYOND: Final = float(stats.chi2.isf(2 * stats.norm.sf(SIGMAS), 3))  # squared Mahalanobis distance: 22.06
TOLERATED: Final = 0.01  # of the rows
LONGEST_SHIFT_S: Final = 5.0  # of the site's time, where no clock is vouched for
SHIFT_STEP_S: Final = 0.005


@dataclass(frozen=True)
class Score:
    """rmse_m: 3D. sigma_m: rms of the stated 3D sigma. nees: mean squared Mahalanobis distance over three.

    beyond: share of rows beyond four sigmas; beyond_length: share of rows whose error is longer than four 3D sigmas.
    """

    rows: int
    rmse_m: float
    sigma_m: float
    nees: float
    beyond: float
    beyond_length: float

    @property
    def confidently_wrong(self) -> bool:
        """Whether more rows lie beyond than are tolerated."""
        return self.beyond > TOLERATED


def score(brought: Brought, solution: Solution) -> Score:
    """Hold a trajectory against the truth at its own stamps."""
    path, origin = solution.trajectory, brought.simulated.scene.origin
    points, turn = in_frame(path.points_enu, solution.network.origin, origin)
    covariance = turn @ path.covariance_enu @ turn.T
    t_unix_ns = path.t_unix_ns
    if brought.time_free:
        t_unix_ns = t_unix_ns + _shift_ns(brought.simulated, points, t_unix_ns)
    return scored(points, covariance, _truths(brought.simulated, t_unix_ns))


def scored(points_m: Array, covariance_m2: Array, truths_m: Sequence[Array]) -> Score:
    """points_m: (M, 3), covariance_m2: (M, 3, 3), truths_m: (M, 3) of each object, NaN while it does not fly."""
    off = np.stack([points_m - truth for truth in truths_m])
    squared = np.einsum("kmi,mij,kmj->km", off, np.linalg.inv(covariance_m2), off)
    squared = np.where(np.isfinite(squared), squared, np.inf)
    nearest, rows = np.argmin(squared, axis=0), np.arange(len(points_m))
    mahalanobis2, error2 = squared[nearest, rows], (off[nearest, rows] ** 2).sum(axis=1)
    variance = np.trace(covariance_m2, axis1=1, axis2=2)
    flying = np.isfinite(mahalanobis2)
    error2 = np.where(flying, error2, np.inf)
    return Score(
        rows=len(points_m),
        rmse_m=float(np.sqrt(np.mean(error2[flying]))) if flying.any() else np.inf,
        sigma_m=float(np.sqrt(np.mean(variance))),
        nees=float(np.mean(mahalanobis2[flying])) / 3 if flying.any() else np.inf,
        beyond=float(np.mean(mahalanobis2 > BEYOND)),
        beyond_length=float(np.mean(error2 > SIGMAS**2 * variance)),
    )


def in_frame(points_enu: Array, own: Origin, other: Origin) -> tuple[Array, Array]:
    """(N, 3) points of one origin's frame in another's, and the rotation (3, 3) that takes vectors there."""
    if own == other:
        return points_enu, np.eye(3)
    turn = R_ecef_enu(other).T @ R_ecef_enu(own)
    return ecef_to_enu(enu_to_ecef(points_enu, own), other), turn


def _truths(simulated: Simulated, t_unix_ns: NDArray[np.int64]) -> list[Array]:
    return [simulated.truth_enu(t_unix_ns, number) for number in range(1, len(simulated.flights) + 1)]


def _shift_ns(simulated: Simulated, points: Array, t_unix_ns: NDArray[np.int64]) -> int:
    """The constant by which the site's time is best taken to be off: nobody vouched for any clock."""
    rows = np.linspace(0, len(points) - 1, min(len(points), 200)).astype(int)
    shifts = np.arange(-LONGEST_SHIFT_S, LONGEST_SHIFT_S, SHIFT_STEP_S)

    def misfit(shift_s: float) -> float:
        truths = _truths(simulated, t_unix_ns[rows] + round(shift_s * 1e9))
        off = np.min([np.linalg.norm(points[rows] - truth, axis=1) for truth in truths], axis=0)
        return float(np.nanmedian(off)) if np.isfinite(off).mean() > 0.5 else np.inf

    return round(float(shifts[int(np.argmin([misfit(shift) for shift in shifts]))]) * 1e9)
