"""Track folders: site.toml and tracks/<camera>.csv, as they stand.

Tracks come from other people's programs. The hazard is the row that is not a measurement. What is no number at all is
dropped and counted here; a pixel outside the image or a row that somebody interpolated is a number, and is judged with
all others by the station's intake (core/intake.py). What cannot be read is an error that names file and line.
"""

import csv
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.observations import SiteCamera
from calib.station.archive import sitefile
from calib.station.config import CameraSection
from calib.station.core.surveyed_site import SurveyedSite
from edge.common.arrays import Array
from edge.common.errors import ConfigError
from edge.messages import MAX_PIXEL, MAX_T_UNIX_NS, MIN_T_UNIX_NS

log = logging.getLogger(__name__)

REQUIRED: Final = ("t_unix_ns", "u_px", "v_px")
TRACK_NUMBERS: Final = 2**53  # how many the wire has


@dataclass(frozen=True)
class TrackRows:
    """One camera's rows in time order: t_unix_ns (N,), pixels (N, 2) raw, track (N,), seen (N,): not interpolated."""

    t_unix_ns: NDArray[np.int64]
    pixels: Array
    track: NDArray[np.int64]
    seen: NDArray[np.bool_]


@dataclass(frozen=True)
class TrackFolder:
    """What a folder holds. site: its survey; cameras: what is known of each; rows: by camera, where there is a file."""

    site: SurveyedSite
    cameras: tuple[SiteCamera, ...]
    rows: dict[str, TrackRows]


def read(folder: Path) -> TrackFolder:
    """A track folder as it stands. Raises ConfigError naming file, line or key and what to do."""
    site_file = folder / "site.toml"
    name, origin, cameras = sitefile.load(site_file)
    known = [camera.id for camera in cameras]
    files = {path.stem: path for path in sorted((folder / "tracks").glob("*.csv"))}
    if not files:
        raise ConfigError("no tracks/*.csv", where=str(folder), action="put one file a camera there")
    for stranger in sorted(set(files) - set(known)):
        log.warning(
            "%s: tracks of a camera that site.toml does not name; name it there, or they stay unused", files[stranger]
        )
    sections = {
        row.id: CameraSection(id=row.id, position=row.position, position_sigma=row.position_sigma)
        for row in sitefile.read(site_file).camera
    }
    rows = {camera: _read_tracks(files[camera]) for camera in known if camera in files}
    return TrackFolder(SurveyedSite(name, origin, sections), cameras, rows)


def _read_tracks(path: Path) -> TrackRows:
    columns = _columns(path)
    t, keep = _stamps(columns["t_unix_ns"], path)
    pixels = np.column_stack([_numbers(columns[name], path, name) for name in ("u_px", "v_px")])
    numbers = np.all(np.abs(pixels) <= MAX_PIXEL, axis=1)  # nan is not
    for reason, rows in (("with a time before 2001 or after 2096", ~keep), ("whose pixel is none", keep & ~numbers)):
        if rows.any():
            log.warning("%s: %d rows %s; not used", path, rows.sum(), reason)
    seen = np.array([status != "interpolated" for status in columns.get("status", [""] * len(t))], bool)
    order = np.flatnonzero(keep & numbers)
    backwards = int(np.sum(np.diff(t[order]) < 0))
    if backwards:
        log.warning("%s: stamps run backwards %d times; sorted", path, backwards)
    order = order[np.argsort(t[order], kind="stable")]
    track = _tracks(columns.get("track", ["0"] * len(t)), path)
    return TrackRows(t[order], pixels[order], track[order], seen[order])


def _tracks(values: list[str], path: Path) -> NDArray[np.int64]:
    """Track numbers; only which are alike matters, so that what the wire has no room for, such as -1, is wrapped."""
    try:
        return np.array([int(number) % TRACK_NUMBERS if number else 0 for number in values], np.int64)
    except ValueError as error:
        raise ConfigError(f"track: {error}", where=str(path), action="give whole numbers, or nothing") from error


def _columns(path: Path) -> dict[str, list[str]]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(line for line in file if not line.startswith("#")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"cannot be read ({error})", where=str(path), action="give a CSV file in UTF-8") from error
    header = [name.strip() for name in rows[0]] if rows else []
    for name in REQUIRED:
        if name not in header:
            raise ConfigError(
                f"no column {name}", where=str(path), action=f"begin with a header of at least {','.join(REQUIRED)}"
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
