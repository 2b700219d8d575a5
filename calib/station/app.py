"""The command `base-station`: run, check, survey, solve.

Exit codes: 0 done; 1 it could not be done, the reason and the next action on stderr; 2 wrong usage or configuration.
Each command loads only what it needs: a station that was killed must be back in seconds, and surveying and solving
take longer to load than all of the station.
"""

import argparse
import logging
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from calib.station.config import load
from edge import __version__
from edge.errors import ConfigError, SkyfixError
from edge.link.zenoh_log import ZenohLog

DEFAULT_CONFIG: Final = Path("/etc/skyfix/base.toml")
LOG_FORMAT: Final = "%(asctime)s %(levelname)s %(message)s"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    parsed = _parser(next((word for word in given if word in COMMANDS), "")).parse_args(given)
    logging.basicConfig(level=logging.DEBUG if parsed.verbose else logging.INFO, format=LOG_FORMAT, stream=sys.stderr)
    try:
        return COMMANDS[parsed.command](parsed)
    except ConfigError as error:
        print(f"base-station: {error}", file=sys.stderr)
        return 2
    except SkyfixError as error:
        print(f"base-station: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 1


def _run(arguments: argparse.Namespace) -> int:
    from calib.station.station import run  # noqa: PLC0415 -- loads only what it needs

    with ZenohLog():
        return run(load(arguments.config), _folder(arguments))


def _check(arguments: argparse.Namespace) -> int:
    from calib.station import check  # noqa: PLC0415 -- as above

    return check.run(load(arguments.config), _folder(arguments))


def _solve(arguments: argparse.Namespace) -> int:
    from calib.station import solve_command  # noqa: PLC0415 -- as above

    return solve_command.run(arguments)


def _survey(arguments: argparse.Namespace) -> int:
    from calib.station.survey import command as survey_command  # noqa: PLC0415 -- as above

    return survey_command.run(arguments)


def _folder(arguments: argparse.Namespace) -> Path:
    """What relative paths in the configuration are relative to: the file's own folder."""
    config: Path = arguments.config
    return config.resolve().parent


COMMANDS: Final[dict[str, Callable[[argparse.Namespace], int]]] = {
    "run": _run,
    "check": _check,
    "survey": _survey,
    "solve": _solve,
}


def _parser(command: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="base-station",
        description="The field computer: calibrates the cameras from what they see, and says where objects are.",
        epilog="Exit codes: 0 done, 1 it could not be done (see stderr), 2 wrong usage or configuration.",
    )
    parser.add_argument("--version", action="version", version=f"skyfix {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _with_config(commands.add_parser("run", help="calibrate, track and send until told to stop"))
    _with_config(commands.add_parser("check", help="show the configuration and whether all it needs is there"))
    survey = commands.add_parser("survey", help="measure or enter where the cameras stand")
    _with_config(survey)
    solve = commands.add_parser("solve", help="calibrate from a track folder or a recording")
    solve.add_argument("--config", type=Path, help="configuration with surveyed positions, for a recording")
    solve.add_argument("-v", "--verbose", action="store_true", help="log more")
    if command == "survey":
        from calib.station.survey import command as survey_command  # noqa: PLC0415 -- as above

        survey_command.add_arguments(survey)
    if command == "solve":
        from calib.station import solve_command  # noqa: PLC0415 -- as above

        solve_command.add_arguments(solve)
    return parser


def _with_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, default=DEFAULT_CONFIG, help=f"default: {DEFAULT_CONFIG}")
    parser.add_argument("-v", "--verbose", action="store_true", help="log more")


if __name__ == "__main__":
    sys.exit(main())
