"""Track folders: site.toml and tracks/<camera>.csv in, trajectory.csv out (DESIGN section 3).

Tracks come from other people's programs. The hazard is the row that is not a measurement: a NaN, a pixel far outside
the image, a stamp that runs backwards, a row somebody interpolated. Such rows are dropped and counted, never believed;
what cannot be read at all is an error that names file and line.
"""

import csv
import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.geodesy import Origin, enu_to_ecef
from calib.observations import Observations, Scene, SiteCamera
from calib.solving.solution import Trajectory
from calib.station.archive import sitefile
from edge.common.arrays import Array
from edge.common.atomic import write_atomically
from edge.common.errors import ConfigError
from edge.messages import MAX_T_UNIX_NS, MIN_T_UNIX_NS

log = logging.getLogger(__name__)

NEEDED: Final = ("t_unix_ns", "u_px", "v_px")
OUTSIDE: Final = 0.1  # of the image size: a box cut by the edge may have its centre so far outside, no further
HEADER: Final = "t_unix_ns,track,x_m,y_m,z_m,east_m,north_m,up_m,sigma_east_m,sigma_north_m,sigma_up_m,cameras"


@dataclass
class Dropped:
    """Rows that were not used, by reason."""

    count: dict[str, int] = field(default_factory=dict)

    def add(self, reason: str, rows: int) -> None:
        """Count rows dropped for a reason; none is no entry."""
        if rows:
            self.count[reason] = self.count.get(reason, 0) + int(rows)

    def __str__(self) -> str:
        return ", ".join(f"{rows} {reason}" for reason, rows in self.count.items())


def load(folder: Path) -> Scene:
    """A track folder as a scene. Raises ConfigError naming file, line or key and what to do."""
    name, origin, cameras = sitefile.load(folder / "site.toml")
    known = {camera.id: camera for camera in cameras}
    files = {path.stem: path for path in sorted((folder / "tracks").glob("*.csv"))}
    if not files:
        raise ConfigError("no tracks/*.csv", where=str(folder), action="put one file a camera there")
    for stranger in sorted(set(files) - set(known)):
        log.warning(
            "%s: tracks of a camera that site.toml does not name; name it there, or they stay unused", files[stranger]
        )
    observations = {camera: _read_tracks(files[camera], known[camera]) for camera in known if camera in files}
    return Scene(name, origin, cameras, observations)


def _read_tracks(path: Path, camera: SiteCamera) -> Observations:
    columns = _columns(path)
    dropped = Dropped()
    t, keep = _stamps(columns["t_unix_ns"], path)
    u, v = _numbers(columns["u_px"], path, "u_px"), _numbers(columns["v_px"], path, "v_px")
    finite = np.isfinite(u) & np.isfinite(v)
    width, height = camera.lens.size_px
    with np.errstate(invalid="ignore"):
        inside = (np.abs(u - width / 2) <= (0.5 + OUTSIDE) * width) & (
            np.abs(v - height / 2) <= (0.5 + OUTSIDE) * height
        )
    measured = np.array([status != "interpolated" for status in columns.get("status", [""] * len(t))], bool)
    dropped.add("with a time before 2001 or after 2096", int(np.sum(~keep)))
    dropped.add("not finite", int(np.sum(keep & ~finite)))
    dropped.add("far outside the image", int(np.sum(keep & finite & ~inside)))
    dropped.add("interpolated", int(np.sum(keep & finite & inside & ~measured)))
    keep &= finite & inside & measured
    order = np.flatnonzero(keep)
    backwards = int(np.sum(np.diff(t[order]) < 0))
    if backwards:
        log.warning("%s: stamps run backwards %d times; sorted", path, backwards)
    order = order[np.argsort(t[order], kind="stable")]
    if dropped.count:
        log.warning("%s: rows not used: %s", path, dropped)
    track = np.array([int(number) if number else 0 for number in columns.get("track", ["0"] * len(t))], np.int64)
    return Observations(t[order], np.column_stack([u, v])[order], track[order])


def _columns(path: Path) -> dict[str, list[str]]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(line for line in file if not line.startswith("#")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"cannot be read ({error})", where=str(path), action="give a CSV file in UTF-8") from error
    header = [name.strip() for name in rows[0]] if rows else []
    for name in NEEDED:
        if name not in header:
            raise ConfigError(
                f"no column {name}", where=str(path), action=f"begin with a header of at least {','.join(NEEDED)}"
            )
    ragged = next((number for number, row in enumerate(rows) if len(row) != len(header)), None)
    if ragged is not None:
        raise ConfigError(f"row {ragged + 1} has {len(rows[ragged])} of {len(header)} columns", where=str(path),
                          action="complete or delete it")  # fmt: skip
    return (
        dict(zip(header, map(list, zip(*rows[1:], strict=True)), strict=True)) if rows[1:] else {n: [] for n in header}
    )


def _stamps(values: list[str], path: Path) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Stamps (N,), and which of them (N,) are times at all. Integers: a double is good to 0.2 us only."""
    try:
        exact = [int(value) for value in values]
    except ValueError as error:
        raise ConfigError(f"t_unix_ns: {error}", where=str(path), action="give whole nanoseconds") from error
    good = np.array([MIN_T_UNIX_NS <= value <= MAX_T_UNIX_NS for value in exact], bool)
    return np.array([value if ok else 0 for value, ok in zip(exact, good, strict=True)], np.int64), good


def _numbers(values: list[str], path: Path, column: str) -> Array:
    try:
        return np.array([float(value) for value in values], np.float64)
    except ValueError as error:
        raise ConfigError(f"{column}: {error}", where=str(path), action="give numbers") from error


def write_trajectory(trajectory: Trajectory, origin: Origin, path: Path) -> None:
    """trajectory.csv of a solution."""
    ecef = enu_to_ecef(trajectory.points_enu, origin)
    sigma = np.sqrt(np.einsum("nii->ni", trajectory.covariance_enu))
    rows = [
        f"{t},{track},{x:.4f},{y:.4f},{z:.4f},{e:.4f},{n:.4f},{u:.4f},{se:.4f},{sn:.4f},{su:.4f},{cameras}"
        for t, track, (x, y, z), (e, n, u), (se, sn, su), cameras in zip(
            trajectory.t_unix_ns.tolist(),
            trajectory.track.tolist(),
            ecef.tolist(),
            trajectory.points_enu.tolist(),
            sigma.tolist(),
            trajectory.cameras.tolist(),
            strict=True,
        )
    ]
    write_atomically(path, "\n".join([HEADER, *rows, ""]).encode())
