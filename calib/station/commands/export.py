"""`base-station export`: the flown tracks of a solution or a recording, for maps and tables."""

import argparse
from dataclasses import replace
from pathlib import Path

from calib.station.archive.flown_file import load
from calib.station.export import FORMATS
from edge.common.atomic import write_atomically
from edge.common.errors import ConfigError, SkyfixError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station export`."""
    parser.epilog = "Gaps stay gaps. Heights are above the WGS 84 ellipsoid; KML and GPX mean the sea: --undulation-m."
    parser.add_argument("source", type=Path, help="a solved folder, its trajectory.csv, or a recording (.mcap)")
    parser.add_argument("--as", dest="format", choices=sorted(FORMATS), required=True, help="what to write")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="where to")
    parser.add_argument(
        "--undulation-m",
        type=float,
        metavar="M",
        help="geoid above ellipsoid there, as in [site] of base.toml: writes KML and GPX above the sea",
    )


def run(arguments: argparse.Namespace) -> int:
    """Read, convert, write. Raises SkyfixError if there is nothing to write, or nowhere to."""
    form = FORMATS[arguments.format]
    if arguments.undulation_m is not None and not form.sea_level:
        raise ConfigError(
            f"{arguments.format} has heights above the ellipsoid",
            where="--undulation-m",
            action="leave it away, or write kml or gpx",
        )
    flown = replace(load(arguments.source), undulation_m=arguments.undulation_m)
    try:
        write_atomically(arguments.output, form.write(flown))
    except OSError as error:
        raise SkyfixError(
            f"cannot be written ({error.strerror})", where=str(arguments.output), action="choose another -o"
        ) from error
    rows = sum(len(track.t_unix_ns) for track in flown.tracks)
    stretches = sum(len(track.stretches()) for track in flown.tracks)
    print(f"{len(flown.tracks)} tracks, {rows} positions in {stretches} stretches written to {arguments.output}")
    if form.sea_level:
        print(flown.heights)
    return 0
