"""Flown tracks in the formats of maps and tables. A format is one file here and one line in FORMATS."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from calib.station.export import geojson, gpx, kml, table
from calib.station.export.flown import Flown


@dataclass(frozen=True)
class Format:
    """How a format is written, and whether its heights are meant above the sea."""

    write: Callable[[Flown], bytes]
    sea_level: bool


FORMATS: Final = {
    "kml": Format(kml.write, sea_level=True),
    "gpx": Format(gpx.write, sea_level=True),
    "geojson": Format(geojson.write, sea_level=False),
    "csv": Format(table.write, sea_level=False),
}
