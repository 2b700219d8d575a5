"""`base-station score`: a trajectory.csv against a truth.csv, under an alignment that is named."""

import argparse
import dataclasses
import json
from pathlib import Path as FilePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.scoring.alignment import ALIGNMENTS
from calib.scoring.consistency import Consistency, Stated
from calib.scoring.timing import TIMINGS, Path
from calib.scoring.trajectory import LONGEST_BRIDGED_S, Evaluation, evaluate
from calib.station.archive import tables
from calib.station.archive.flown_file import SIGMAS
from edge.common.arrays import Array
from edge.common.errors import SkyfixError

# Two tracks of one object may touch for a moment when one is handed over to the other; more is a second object.
SHARED_SHARE: Final = 0.1
COVARIANCES: Final = {"cov_en_m2": (0, 1), "cov_eu_m2": (0, 2), "cov_nu_m2": (1, 2)}


def read_truth(path: FilePath) -> Path:
    """A truth.csv: t_s, east_m, north_m, up_m."""
    table = tables.read(path, ("t_s", "east_m", "north_m", "up_m"), SkyfixError)
    return _path(table.finite("t_s"), _positions(table))


def read_trajectory(path: FilePath, track: int | None = None) -> tuple[Path, Stated | None, tuple[int, ...]]:
    """The path of a trajectory.csv, what it states of its own errors, if it does, and the tracks it is made of.

    track: one track alone; None takes the longest, and every other that hardly overlaps those already taken.
    """
    table = tables.read(path, ("t_unix_ns", "track", "east_m", "north_m", "up_m"), SkyfixError)
    tracks = table.whole("track")
    stamps = table.whole("t_unix_ns")
    taken = (track,) if track is not None else _one_object(stamps, tracks)
    rows = np.flatnonzero(np.isin(tracks, taken))
    if not len(rows):
        raise SkyfixError(f"no rows of track {track}", where=str(path), action=f"it has {sorted(set(tracks))}")
    _, first = np.unique(stamps[rows], return_index=True)
    rows = rows[first]
    stated = _stated(table)
    estimate = Path(np.asarray(stamps[rows] * 1e-9, float), _positions(table)[rows])
    return estimate, None if stated is None else stated.chosen(rows), taken


def _stated(table: tables.CsvTable) -> Stated | None:
    """What a trajectory says of its errors. One written before correlations were has none of them."""
    if not {*SIGMAS, "cameras"} <= set(table.columns):
        return None
    sigma = np.column_stack([table.finite(name) for name in SIGMAS])
    covariance = np.einsum("ni,ij->nij", sigma**2, np.eye(3))
    for name, (i, j) in COVARIANCES.items():
        if name in table.columns:
            covariance[:, i, j] = covariance[:, j, i] = table.finite(name)
    return Stated(covariance, table.whole("cameras"))


def _one_object(stamps: NDArray[np.int64], numbers: NDArray[np.int64]) -> tuple[int, ...]:
    """Tracks that may be one object's: longest first, each next one where the ones before it have no rows."""
    taken: list[int] = []
    rows_of = {int(number): np.flatnonzero(numbers == number) for number in np.unique(numbers)}
    covered: set[int] = set()
    for number in sorted(rows_of, key=lambda n: (-len(rows_of[n]), n)):
        times = set(stamps[rows_of[number]].tolist())
        if len(times & covered) <= SHARED_SHARE * len(times):
            taken.append(number)
            covered |= times
    return tuple(taken)


def _path(t_s: Array, enu: Array) -> Path:
    """In time order, one row a time."""
    times, first = np.unique(t_s, return_index=True)
    return Path(times, enu[first])


def _positions(table: tables.CsvTable) -> Array:
    if not table.lines:
        raise table.source.fault("it has a header and no row", "give a file with positions")
    return np.column_stack([table.finite(axis) for axis in ("east_m", "north_m", "up_m")])


def table(result: Evaluation) -> str:
    """The result as people read it."""
    axes = [
        ("RMSE per axis", result.rmse_axis_m, " m"),
        ("MAE per axis", result.mae_axis_m, " m"),
        ("R² per axis", result.r_squared_axis, ""),
    ]
    lines = [
        f"alignment {result.alignment}, clock {result.timing}: "
        f"{result.matched} of {result.truth_rows} truth rows in the estimate's time span",
        f"  shift {result.shift_s:+.4f} s  rate {result.rate * 1e6:+.1f} ppm  yaw {result.yaw_deg:+.3f} deg  "
        f"tilt {result.tilt_deg:.3f} deg  scale {result.scale:.6f}",
        f"  RMSE            {result.rmse_m:9.4f} m",
        f"  median          {result.median_m:9.4f} m",
        f"  maximum         {result.maximum_m:9.4f} m",
        f"  MAE (1-norm)    {result.mae_1_norm_m:9.4f} m",
        f"  MAE (2-norm)    {result.mae_2_norm_m:9.4f} m",
        f"  R²              {result.r_squared:9.6f}",
        *(f"  {name:15s} {e:9.4f} {n:9.4f} {u:9.4f}{unit}  (east, north, up)" for name, (e, n, u), unit in axes),
    ]
    return "\n".join(lines + _honesty(result.consistency))


def _honesty(parts: tuple[Consistency, ...]) -> list[str]:
    """How true the stated sigma is, a line for each part of the rows; none where nothing was stated."""
    if not parts:
        return []
    return [
        "",
        f"  {'against its own sigma':21s} {'rows':>6s} {'RMSE m':>8s} {'sigma m':>8s} {'error/sigma':>11s} "
        f"{'NEES':>7s} {'beyond 99.9 %':>13s}   (true: 1.0, 3.0, 0.1 %)",
        *(
            f"  {part.over:21s} {part.rows:6d} {part.rmse_m:8.3f} {part.sigma_m:8.3f} {part.error_over_sigma:11.2f} "
            f"{part.nees:7.2f} {part.beyond:13.1%}"
            for part in parts
        ),
    ]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station score`."""
    parser.add_argument("trajectory", type=FilePath)
    parser.add_argument("truth", type=FilePath)
    parser.add_argument("--align", choices=ALIGNMENTS, default="yaw", help="what is given away (default: yaw)")
    parser.add_argument("--time", choices=TIMINGS, default="rate", help="what is found of the clocks (default: rate)")
    parser.add_argument("--track", type=int, help="one track alone (default: all that can be one object)")
    parser.add_argument(
        "--max-gap", type=float, default=LONGEST_BRIDGED_S, metavar="S", help="longest gap interpolated over"
    )
    parser.add_argument("--json", type=FilePath, metavar="FILE", help="write the result there as well")


def run(arguments: argparse.Namespace) -> int:
    """Read, score, print. Raises SkyfixError if the files cannot be compared."""
    estimate, stated, tracks = read_trajectory(arguments.trajectory, arguments.track)
    truth = read_truth(arguments.truth)
    result = evaluate(estimate, truth, arguments.align, arguments.time, arguments.max_gap, stated=stated)
    print(f"tracks {', '.join(map(str, tracks))}")
    print(table(result))
    if arguments.json:
        arguments.json.write_text(json.dumps(dataclasses.asdict(result), indent=2) + "\n", encoding="utf-8")
    return 0
