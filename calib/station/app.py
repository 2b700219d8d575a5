"""The command `base-station`: one file a subcommand, in commands/.

Exit codes: 0 done; 1 it could not be done, the reason and the next action on stderr; 2 wrong usage or configuration.
Each command loads only what it needs: a station that was killed must be back in seconds, and surveying and solving
take longer to load than all of the station.
"""

import argparse
import importlib
import logging
import os
import sys
from collections.abc import Sequence
from typing import Any, Final

from edge import __version__
from edge.common.errors import ConfigError, SkyfixError

LOG_FORMAT: Final = "%(asctime)s %(levelname)s %(message)s"
# What can be asked for, in the order in which a user meets it; each is calib/station/commands/<name>.py.
COMMANDS: Final = {
    "run": "calibrate, track and send until told to stop",
    "check": "show the configuration and whether all it needs is there",
    "init": "write the configurations of a new site, which fit one another",
    "survey": "measure or enter where the cameras stand",
    "solve": "calibrate from a track folder or a recording",
    "replay": "play a track folder or a recording to a running station",
    "simulate": "make up a flight, with every error you like",
    "score": "score a trajectory against a truth",
    "export": "write the flown tracks for maps and tables: KML, GPX, GeoJSON, CSV",
    "certs": "make the certificates of a site's machines",
    "router": "route a site's messages",
}
EXTRAS: Final = {"certs": "certs"}  # which extra brings a subcommand's libraries, where it is not `base`
OURS: Final = ("calib", "edge")
# Read when numpy is loaded. The matrices here are many and small: a second thread waits for the first by spinning,
# which doubled the CPU time of a solve and made nothing faster.
BLAS_THREADS: Final = {"OPENBLAS_NUM_THREADS": "1"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    for name, count in BLAS_THREADS.items():
        os.environ.setdefault(name, count)
    given = list(sys.argv[1:] if arguments is None else arguments)
    chosen = next((word for word in given if word in COMMANDS), "")
    try:
        parsed = build_parser(chosen).parse_args(given)
        level = logging.DEBUG if parsed.verbose else logging.INFO
        logging.basicConfig(level=level, format=LOG_FORMAT, stream=sys.stderr)
        return int(_module(parsed.command).run(parsed))
    except ConfigError as error:
        print(f"base-station: {error}", file=sys.stderr)
        return 2
    except SkyfixError as error:
        print(f"base-station: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 1


def build_parser(*chosen: str) -> argparse.ArgumentParser:
    """The command line. chosen: the subcommands whose own arguments are wanted; loading all takes seconds."""
    parser = argparse.ArgumentParser(
        prog="base-station",
        description="The field computer: calibrates the cameras from what they see, and says where objects are.",
        epilog="Exit codes: 0 done, 1 it could not be done (see stderr), 2 wrong usage or configuration.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s (skyfix) {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, purpose in COMMANDS.items():
        command = commands.add_parser(name, help=purpose, description=purpose[0].upper() + purpose[1:] + ".")
        command.add_argument("-v", "--verbose", action="store_true", help="log more")
        if name in chosen:
            _module(name).add_arguments(command)
    return parser


def _module(command: str) -> Any:
    """A subcommand's module. Raises SkyfixError where its libraries are not installed, as those of a base on a box."""
    try:
        return importlib.import_module(f"calib.station.commands.{command}")
    except ModuleNotFoundError as error:
        library = (error.name or OURS[0]).partition(".")[0]
        if library in OURS:
            raise
        raise SkyfixError(
            f"{library} is not installed",
            where=command,
            action=f"pip install 'skyfix[{EXTRAS.get(command, 'base')}]'",
        ) from error


if __name__ == "__main__":
    sys.exit(main())
