"""`base-station init`: the configurations of a new site, which fit one another."""

import argparse
from pathlib import Path

from calib.station.new_site import NewSite
from edge.common.atomic import write_atomically
from edge.common.errors import ConfigError, SkyfixError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station init`."""
    parser.add_argument("site", metavar="SITE", help="the site's name: letters, digits, _ and -")
    parser.add_argument("--cameras", type=int, default=3, metavar="N", help="how many cameras (default: 3)")
    parser.add_argument(
        "--base",
        metavar="ADDRESS",
        help="the base's address as the boxes dial it, with certificates (default: a bench, all on this machine)",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="where to (default: ./SITE)")


def run(arguments: argparse.Namespace) -> int:
    """Write them. Raises ConfigError if one is there already, SkyfixError if they cannot be written."""
    site = NewSite(arguments.site, arguments.cameras, arguments.base)
    folder = arguments.output or Path(site.name)
    files = site.files()
    for name in files:
        if (folder / name).exists():
            raise ConfigError("is there already", where=str(folder / name), action="give another -o, or remove it")
    try:
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(folder / name, text.encode())
    except OSError as error:
        raise SkyfixError(
            f"cannot be written ({error.strerror})", where=str(folder), action="choose another -o"
        ) from error
    for name in files:
        print(f"written {folder / name}")
    if site.certificates:
        print("copy each to /etc/skyfix on its machine; then make the certificates (deploy/certs/README.md):")
        print("\n".join(f"  {command}" for command in site.certificates))
    else:
        print("for a bench: base and boxes on this machine. For a field give the base's address with --base.")
    return 0
