"""The covariance is true: errors of many simulated flights, in its own units, add up to what chance allows."""

import numpy as np
from scipy import stats

from calib.simulation.description import LensFault
from tests.calib.flights import site
from tests.synthetic.solving import solved

FLIGHTS = 24
CHANCE = 1e-3  # that a true covariance fails here


def middle_squared(trial: int) -> float:
    """Squared error at the middle of a flight in units of its covariance: chi-square of 3 if that is true."""
    drawn = LensFault(focal=0.01, centre_px=10.0, k1=0.01)
    description = site(
        offsets_s=(0.0,) * 4, seed=trial, duration_s=40.0, each={"lens_error": drawn, "clock_bound_s": 1e-4}
    )
    found = solved(description, trial=trial)
    trajectory = found.solution.trajectory
    row = len(trajectory.t_unix_ns) // 2
    off = trajectory.points_enu[row] - found.truth.truth_enu(trajectory.t_unix_ns[row : row + 1])[0]
    return float(off @ np.linalg.solve(trajectory.covariance_enu[row], off))


def test_normalised_squared_errors_are_chi_square() -> None:
    total = sum(middle_squared(trial) for trial in range(FLIGHTS))
    low, high = stats.chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], 3 * FLIGHTS)
    assert low < total < high
