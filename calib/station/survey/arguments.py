"""The arguments of `base-station survey`: one place that says what can be asked for."""

import argparse
from pathlib import Path
from typing import Final

from calib.station.commands.arguments import add_config
from calib.station.survey.edit import CSV_COLUMNS
from calib.station.survey.in_force import SURVEY_FILE
from edge.gnss.averaging import SERVICES

OCCUPATION_S: Final = 180.0  # two of it, the guidance for network RTK; longer gains a third at 600 s
POINTS: Final = ("phase-centre", "ARP")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The actions of `base-station survey`."""
    add_config(parser)
    parser.add_argument("--file", type=Path, help=f"survey file (default: site.survey, or {SURVEY_FILE} beside it)")
    actions = parser.add_subparsers(dest="action", metavar="ACTION")
    actions.add_parser("show", help="every position, how it is known, closures and tapes (the default)")
    _add_rover(actions.add_parser("occupy", help="occupy one tripod with the rover, twice"), one=True)
    _add_rover(actions.add_parser("rover", help="go from tripod to tripod and close on the first"), one=False)
    boxes = actions.add_parser("boxes", help="take the positions that the boxes' own receivers have averaged")
    _add_yes(boxes)
    boxes.add_argument("--seconds", type=float, default=15.0, help="how long to listen (default: 15)")
    typed = actions.add_parser("enter", help="enter a lens position")
    typed.add_argument("camera")
    typed.add_argument("latitude", type=float, help="degrees")
    typed.add_argument("longitude", type=float, help="degrees")
    typed.add_argument("height", type=float, help="metres above the ellipsoid")
    typed.add_argument("--sigma", type=float, nargs=3, metavar=("EAST", "NORTH", "UP"), required=True, help="metres")
    _add_yes(typed)
    typed.add_argument("--source", default="typed in", help="where the numbers come from")
    table = actions.add_parser("import", help=f"enter a CSV file with the columns {','.join(CSV_COLUMNS)}")
    table.add_argument("csv", type=Path)
    _add_yes(table)
    drop = actions.add_parser("drop", help="remove a tripod, or one of its occupations")
    drop.add_argument("camera")
    drop.add_argument("occupation", type=int, nargs="?", help="its number in `survey show`")
    right = actions.add_parser("trust", help="say that a tripod's position is right though a round did not close")
    right.add_argument("camera")
    tape = actions.add_parser("tape", help="add a taped distance between two lenses")
    tape.add_argument("first")
    tape.add_argument("second")
    tape.add_argument("metres", type=float)
    tape.add_argument("--sigma", type=float, default=0.01, help="of the tape, metres (default: 0.01)")
    _add_frame(actions.add_parser("frame", help="say which frame the coordinates are in, or convert them"))
    check = actions.add_parser("check", help="test the survey against a calibrated network")
    check.add_argument("network", type=Path, help="network.toml")


def _add_yes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--yes", action="store_true", help="replace what contradicts it without asking")


def _add_rover(parser: argparse.ArgumentParser, *, one: bool) -> None:
    if one:
        parser.add_argument("camera")
    parser.add_argument("--device", help="the rover's port (default: receiver.device of the configuration)")
    parser.add_argument("--service", choices=sorted(SERVICES), help="kind of corrections (default: receiver.service)")
    parser.add_argument("--baseline", type=float, help="metres to the base station (default: receiver.baseline_m)")
    parser.add_argument("--separation", type=float, help="as receiver.separation_m: geoid above ellipsoid, metres")
    parser.add_argument(
        "--accept-unknown-age", action="store_true", default=None, help="as receiver.accept_unknown_age"
    )
    parser.add_argument("--seconds", type=float, default=OCCUPATION_S, help=f"each time (default: {OCCUPATION_S:g})")
    parser.add_argument("--once", action="store_true", help="one occupation only: a false fix goes unseen")
    parser.add_argument(
        "--yes", action="store_true", help="accept what passes, and replace what contradicts it, without asking"
    )
    parser.add_argument("--above-lens", type=float, help="metres from the lens up to the antenna")
    parser.add_argument("--measured-to", choices=POINTS, help="point of the antenna that is meant")
    parser.add_argument("--position-of", choices=POINTS, default="phase-centre", help="NMEA: phase-centre")
    parser.add_argument("--phase-centre-above-arp", type=float, help="metres, from the antenna's data sheet")
    parser.add_argument("--beside-lens", type=float, default=0.0, help="metres, at most 0.010")
    parser.add_argument("--antenna", default="", help="the antenna's model")
    parser.add_argument("--measured-by", default="", help="who measured the height")


def _add_frame(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--is", dest="raw_frame", help="frame of the raw coordinates, such as EPSG:7931")
    parser.add_argument("--epoch", type=float, help="of the coordinates, decimal year")
    parser.add_argument("--from-service", help="correction service and mountpoint")
    parser.add_argument("--from-base", help="base station, and how its own position is known")
    parser.add_argument("--convert-to", help="EPSG:9989 (ITRF2020), EPSG:10605 (WGS 84 G2296), or none")
    parser.add_argument(
        "--shift", type=float, nargs=3, metavar=("EAST", "NORTH", "UP"), help="metres, added to every point"
    )
    parser.add_argument("--shift-note", help="where the shift comes from")
