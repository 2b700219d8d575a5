"""trajectory.csv says of a position what the solver said: a covariance stays one however thin its ellipsoid is."""

import csv

import numpy as np

from calib.solving.solution import Trajectory
from calib.station.archive.trajectory_file import write_trajectory

ORIGIN = (47.4, 8.5, 580.0)


def test_a_needle_of_seventy_metres_comes_back_as_thin_as_it_was(tmp_path):
    axes = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    covariance = (axes * np.array([0.1, 0.3, 70.0]) ** 2) @ axes.T
    once = np.ones(1, np.int64)
    write_trajectory(
        Trajectory(once, once, np.zeros((1, 3)), covariance[None], 2 * once), ORIGIN, "a flight", tmp_path / "t"
    )
    row = next(csv.DictReader(line for line in (tmp_path / "t").read_text().splitlines() if line[0] != "#"))
    read = np.diag([float(row[name]) ** 2 for name in ("sigma_east_m", "sigma_north_m", "sigma_up_m")])
    for name, at in {"cov_en_m2": (0, 1), "cov_eu_m2": (0, 2), "cov_nu_m2": (1, 2)}.items():
        read[at] = read[at[::-1]] = float(row[name])
    # nine digits of 4900 square metres leave 2e-5 of the hundredth of one across
    np.testing.assert_allclose(np.sqrt(np.linalg.eigvalsh(read)), [0.1, 0.3, 70.0], rtol=0.01)
