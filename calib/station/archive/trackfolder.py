"""Track folders: site.toml and tracks/<camera>.csv, as they stand.

Tracks come from other people's programs. The hazard is the row that is not a measurement. What is no number at all is
dropped and counted here; a pixel outside the image or a row that somebody interpolated is a number, and is judged with
all others by the station's intake (core/intake.py). What cannot be read is an error that names file and line.
"""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.observations import SiteCamera
from calib.station.archive import sitefile, tables, track_columns
from calib.station.archive.picture_format import refuse_other_format
from calib.station.config import CameraSection
from calib.station.core.coordinates import MORE_DIGITS
from calib.station.core.surveyed_site import SurveyedSite
from edge.common.arrays import Array
from edge.common.errors import ConfigError
from edge.messages import MAX_PIXEL

log = logging.getLogger(__name__)

REQUIRED: Final = (track_columns.STAMP, "u_px", "v_px")


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
    file, (name, origin, cameras) = sitefile.read(site_file), sitefile.load(site_file)
    files = _files(folder, [camera.id for camera in cameras])
    sections = {
        row.id: CameraSection(id=row.id, position=row.position, position_sigma=row.position_sigma)
        for row in file.camera
    }
    if coarse := sitefile.written_in(file).coarse:
        log.warning("%s: %s; %s", site_file, coarse, MORE_DIGITS)
    rows = {camera.id: _read_tracks(files[camera.id]) for camera in cameras if camera.id in files}
    for camera in cameras:
        if camera.id in rows:
            own = rows[camera.id]
            refuse_other_format(own.pixels[own.seen], own.track[own.seen], camera.lens.size_px, files[camera.id])
    return TrackFolder(SurveyedSite(name, origin, sections), cameras, rows)


def _files(folder: Path, known: list[str]) -> dict[str, Path]:
    """The track file of each camera that has one. Raises ConfigError if there is none, or only the case differs."""
    files = {path.stem: path for path in sorted((folder / "tracks").glob("*")) if path.suffix.lower() == ".csv"}
    if not files:
        raise ConfigError("no tracks/*.csv", where=str(folder), action="put one file a camera there")
    without = {camera.lower(): camera for camera in known if camera not in files}
    for stranger in sorted(set(files) - set(known)):
        if meant := without.get(stranger.lower().strip()):
            raise ConfigError(
                f"is no camera's, and camera {meant} has no file: they differ by case only",
                where=str(files[stranger]),
                action=f"rename it to {meant}.csv",
            )
        log.warning(
            "%s: tracks of a camera that site.toml does not name; name it there, or they stay unused", files[stranger]
        )
    return files


def _read_tracks(path: Path) -> TrackRows:
    table = tables.read(path, REQUIRED)
    t, keep = track_columns.stamps(table)
    pixels = np.column_stack([table.numbers(name) for name in REQUIRED[1:]])
    numbers = np.all(np.abs(pixels) <= MAX_PIXEL, axis=1)  # nan is not
    for reason, rows in (("with a time before 2001 or after 2096", ~keep), ("whose pixel is none", keep & ~numbers)):
        if rows.any():
            first = table.lines[int(np.flatnonzero(rows)[0])]
            log.warning("%s: %d rows %s, the first in line %d; not used", path, rows.sum(), reason, first)
    status = table.columns.get("status", [""] * len(t))
    seen = np.array([value.strip().lower() != "interpolated" for value in status], bool)
    order = np.flatnonzero(keep & numbers)
    backwards = int(np.sum(np.diff(t[order]) < 0))
    if backwards:
        log.warning("%s: stamps run backwards %d times; sorted", path, backwards)
    order = order[np.argsort(t[order], kind="stable")]
    return TrackRows(t[order], pixels[order], track_columns.tracks(table)[order], seen[order])
