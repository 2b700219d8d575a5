"""What was flown, from a trajectory.csv, a solved folder or a recording.

The hazard is the row that nobody measured: of a recording only confirmed targets count, for a coasting one is a guess
and a tentative one may be nothing; so both leave a gap.
"""

import logging
from collections import defaultdict
from pathlib import Path
from typing import Final

import numpy as np

from calib.geodesy import R_ecef_enu, ecef_to_geodetic
from calib.station.archive import recording, tables
from calib.station.export.flown import Flown, Track
from edge.common.arrays import Array
from edge.common.errors import MessageError, SkyfixError
from edge.messages import Target, Targets, decode

log = logging.getLogger(__name__)

AXES: Final = ("x_m", "y_m", "z_m")
SIGMAS: Final = ("sigma_east_m", "sigma_north_m", "sigma_up_m")
# Where the 3 x 3 of the position stands in the row-major upper triangle of the 6 x 6 of position and velocity.
POSITION: Final = np.array([[0, 1, 2], [1, 6, 7], [2, 7, 11]])


def load(path: Path) -> Flown:
    """The flown tracks. Raises SkyfixError if there is nothing to read or nothing in it."""
    tracks = _of_recording(path) if path.suffix == ".mcap" else _of_trajectory(_trajectory_in(path))
    if not tracks:
        raise SkyfixError(
            "no confirmed position in it", where=str(path), action="solve it first: base-station solve FILE -o FOLDER"
        )
    return Flown(path.resolve().name, tracks)


def _trajectory_in(path: Path) -> Path:
    if path.is_dir() and not (path / "trajectory.csv").exists():
        raise SkyfixError(
            "no trajectory.csv in it", where=str(path), action="solve it first: base-station solve FOLDER -o SOLVED"
        )
    return path / "trajectory.csv" if path.is_dir() else path


def _of_trajectory(path: Path) -> tuple[Track, ...]:
    table = tables.read(path, ("t_unix_ns", "track", *AXES, *SIGMAS), SkyfixError)
    stamps, owners = (table.whole(column) for column in ("t_unix_ns", "track"))
    ecef, sigma = (np.column_stack([table.finite(column) for column in columns]) for columns in (AXES, SIGMAS))
    rows_of = [np.flatnonzero(owners == number) for number in np.unique(owners)]
    return tuple(_track(int(owners[rows[0]]), stamps[rows].tolist(), ecef[rows], sigma[rows]) for rows in rows_of)


def _of_recording(path: Path) -> tuple[Track, ...]:
    rows: dict[int, list[tuple[int, Target]]] = defaultdict(list)
    refused = 0
    for message in recording.read(path):
        if not message.key.endswith("/station/targets"):
            continue
        try:
            told = decode(message.payload, Targets, where=message.key)
        except MessageError:
            refused += 1
            continue
        for target in told.targets:
            if target.state == "confirmed":
                rows[target.track].append((told.t_unix_ns, target))
    if refused:
        log.warning("%s: %d messages are no targets; left out", path, refused)
    return tuple(_of_targets(number, rows[number]) for number in sorted(rows))


def _of_targets(number: int, rows: list[tuple[int, Target]]) -> Track:
    ecef = np.array([target.ecef_m for _, target in rows], float)
    covariance = np.array([target.covariance for _, target in rows], float)[:, POSITION]
    # One rotation for all of a track: over the kilometres that it flies, the vertical turns by less than a milliradian.
    lat, lon, height = ecef_to_geodetic(ecef[:1])[0].tolist()
    R = R_ecef_enu((lat, lon, height))
    variance = np.einsum("ia,nij,ja->na", R, covariance, R)
    return _track(number, [t for t, _ in rows], ecef, np.sqrt(np.maximum(variance, 0.0)))


def _track(number: int, stamps_ns: list[int], ecef: Array, sigma_enu_m: Array) -> Track:
    """In time order, one row a time."""
    times, first = np.unique(np.array(stamps_ns, np.int64), return_index=True)
    return Track(number, times, ecef_to_geodetic(ecef[first]), sigma_enu_m[first])
