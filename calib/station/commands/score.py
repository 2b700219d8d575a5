"""`base-station score`: a trajectory.csv against a truth.csv, under an alignment that is named."""

import argparse
import dataclasses
import json
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from calib.scoring.alignment import ALIGNMENTS
from calib.scoring.timing import TIMINGS, Path
from calib.scoring.trajectory import LONGEST_BRIDGED_S, Evaluation, evaluate
from calib.station.archive import tables
from edge.common.arrays import Array
from edge.common.errors import SkyfixError

# Two tracks of one object may touch for a moment when one is handed over to the other; more is a second object.
SHARED_SHARE = 0.1


def read_truth(path: FilePath) -> Path:
    """A truth.csv: t_s, east_m, north_m, up_m."""
    table = tables.read(path, ("t_s", "east_m", "north_m", "up_m"), SkyfixError)
    return _path(table.finite("t_s"), _positions(table))


def read_trajectory(path: FilePath, track: int | None = None) -> tuple[Path, tuple[int, ...]]:
    """The path of a trajectory.csv and the tracks it is made of.

    track: one track alone; None takes the longest, and every other that hardly overlaps those already taken.
    """
    table = tables.read(path, ("t_unix_ns", "track", "east_m", "north_m", "up_m"), SkyfixError)
    tracks = table.whole("track")
    stamps = table.whole("t_unix_ns")
    taken = (track,) if track is not None else _one_object(stamps, tracks)
    rows = np.isin(tracks, taken)
    if not rows.any():
        raise SkyfixError(f"no rows of track {track}", where=str(path), action=f"it has {sorted(set(tracks))}")
    return _path(np.asarray(stamps[rows] * 1e-9, float), _positions(table)[rows]), taken


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
    return "\n".join(lines)


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
    estimate, tracks = read_trajectory(arguments.trajectory, arguments.track)
    result = evaluate(estimate, read_truth(arguments.truth), arguments.align, arguments.time, arguments.max_gap)
    print(f"tracks {', '.join(map(str, tracks))}")
    print(table(result))
    if arguments.json:
        arguments.json.write_text(json.dumps(dataclasses.asdict(result), indent=2) + "\n", encoding="utf-8")
    return 0
