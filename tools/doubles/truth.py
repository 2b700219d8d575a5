"""Positions that were sent against where the simulated objects were: metres, and errors in units of their own sigma.

A position is judged by what it says of itself. With a true covariance P the error e has e' P^-1 e distributed as
chi-squared with three degrees of freedom: half below 2.37, 95 % below 7.81, 99.9 % below 16.27. A position that is
metres off and says so is honest; one that is centimetres off and claims millimetres is not.
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from calib.geodesy import Origin, R_ecef_enu, ecef_to_enu
from calib.station.archive.flown_file import POSITION
from tools.doubles.box import lap_of
from tools.doubles.heard import Sent

CHI2_3_MEDIAN: Final = 2.37
CHI2_3_95: Final = 7.81
LAP_SETTLES_S: Final = 5.0  # of each lap: there the objects jump back to where they began, and no tracker can know that

Array = np.ndarray[Any, np.dtype[np.float64]]


class Error(NamedTuple):
    """A confirmed position's error, when it was sent (UTC s), and how many degrees of freedom's worth of it (NEES)."""

    sent_unix_s: float
    metres: float
    nees: float


class Truth:
    """Where the objects of a track folder are, the flight having begun at an instant and beginning anew at its end."""

    def __init__(self, tracks: Path, start_unix_s: float) -> None:
        lat, lon, height = tomllib.loads((tracks / "site.toml").read_text())["site"]["origin"]
        self._origin = (float(lat), float(lon), float(height))
        self._paths = [np.loadtxt(f, delimiter=",", skiprows=1) for f in sorted((tracks / "truth").glob("*.csv"))]
        self._start_s = start_unix_s
        self._began_s, self._lap_s = (ns * 1e-9 for ns in lap_of(tracks))

    def errors(self, sent: list[Sent]) -> list[Error]:
        """Of every confirmed target, to the nearest object; the first seconds of each lap are left out."""
        found = []
        for position in sent:
            into_lap_s = (position.t_unix_ns * 1e-9 - self._start_s) % self._lap_s
            if into_lap_s > LAP_SETTLES_S:
                error = self._error(position, self._began_s + into_lap_s)
                found.append(Error(position.t_arrival_ns * 1e-9, *error))
        return found

    def _error(self, target: Sent, t_s: float) -> tuple[float, float]:
        position = ecef_to_enu(np.array([target.ecef_m]), self._origin)[0]
        there = np.array([[np.interp(t_s, path[:, 0], path[:, axis]) for axis in (1, 2, 3)] for path in self._paths])
        error = position - there[np.argmin(np.linalg.norm(there - position, axis=1))]
        (turned,) = sent_covariances([target.covariance], self._origin)
        return float(np.linalg.norm(error)), float(error @ np.linalg.solve(turned, error))


def sent_covariances(upper: Sequence[Sequence[float]], origin: Origin) -> Array:
    """(N, 3, 3) of position, m2, ENU, of what N messages say: upper triangles of 6 x 6, ECEF, row by row."""
    R = R_ecef_enu(origin)
    return np.asarray(R.T @ np.array(upper, float)[:, POSITION] @ R)
