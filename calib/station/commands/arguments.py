"""What several subcommands ask for in the same words."""

import argparse
from pathlib import Path
from typing import Final

DEFAULT_CONFIG: Final = Path("/etc/skyfix/base.toml")


def add_config(parser: argparse.ArgumentParser, *, needed: bool = True, what: str = "") -> None:
    """`--config FILE`. needed: a command that cannot do without falls back to the installed file."""
    default = DEFAULT_CONFIG if needed else None
    said = what or (f"the station's configuration (default: {DEFAULT_CONFIG})")
    parser.add_argument("--config", type=Path, default=default, metavar="FILE", help=said)


def folder_of(config: Path) -> Path:
    """What relative paths in a configuration are relative to: the file's own folder."""
    return config.resolve().parent


def positive(text: str) -> float:
    """A number above 0, for argparse. Raises ArgumentTypeError."""
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError("give a number above 0")
    return value
