"""The covariance is true: errors of many simulated flights, in its own units, add up to what chance allows."""

import numpy as np
from msgspec.structs import replace
from scipy import stats

from calib.adjustment.joint_prior import TYPE_SHARES
from calib.adjustment.priors import FOCAL_SIGMA
from calib.simulation.description import CameraSpec, LensFault, Simulation
from tests.calib.flights import site
from tests.synthetic.solving import solved

FLIGHTS = 24
CHANCE = 1e-3  # that a true covariance fails here
K1_SIGMA = 0.01  # of the prior of the default lens model


def drawn(trial: int) -> Simulation:
    """A site whose lens files err as the prior says: in part all alike, in part each by itself."""
    alone = np.sqrt(1 - TYPE_SHARES)
    rng = np.random.default_rng(trial)
    focal, bent = np.sqrt(TYPE_SHARES) * np.array([FOCAL_SIGMA, K1_SIGMA]) * rng.normal(size=2)
    each = {
        "lens_error": LensFault(focal=FOCAL_SIGMA * alone, centre_px=10.0, k1=K1_SIGMA * alone),
        "clock_bound_s": 1e-4,
    }
    exact = site(offsets_s=(0.0,) * 4, seed=trial, duration_s=40.0, each=each)
    return replace(exact, camera=tuple(alike(camera, float(focal), float(bent)) for camera in exact.camera))


def alike(camera: CameraSpec, focal: float, bent: float) -> CameraSpec:
    """A camera whose lens file is off by what those of all its type are off by."""
    fx, fy, cx, cy = camera.intrinsics
    k1, *others = camera.distortion
    published = (fx * (1 + focal), fy * (1 + focal), cx, cy)
    return replace(camera, published_intrinsics=published, published_distortion=(k1 + bent, *others))


def middle_squared(trial: int) -> float:
    """Squared error at the middle of a flight in units of its covariance: chi-square of 3 if that is true."""
    found = solved(drawn(trial), trial=trial)
    trajectory = found.solution.trajectory
    row = len(trajectory.t_unix_ns) // 2
    off = trajectory.points_enu[row] - found.truth.truth_enu(trajectory.t_unix_ns[row : row + 1])[0]
    return float(off @ np.linalg.solve(trajectory.covariance_enu[row], off))


def test_normalised_squared_errors_are_chi_square() -> None:
    total = sum(middle_squared(trial) for trial in range(FLIGHTS))
    low, high = stats.chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], 3 * FLIGHTS)
    assert low < total < high
