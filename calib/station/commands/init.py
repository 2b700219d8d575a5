"""`base-station init`: the configurations of a new site, which fit one another, and its certificates if wanted."""

import argparse
import datetime as dt
import importlib
from pathlib import Path
from typing import Any, Final

from calib.station.new_site import NewSite
from edge.common.atomic import write_atomically
from edge.common.errors import ConfigError, SkyfixError

AUTHORITY: Final = "certs/authority.key"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station init`."""
    parser.add_argument("site", metavar="SITE", help="the site's name: letters, digits, _ and -")
    parser.add_argument("--cameras", type=int, default=3, metavar="N", help="how many cameras (default: 3)")
    parser.add_argument(
        "--base",
        metavar="ADDRESS",
        help="the base's address as the boxes dial it, with certificates (default: a bench, all on this machine)",
    )
    parser.add_argument("--certs", action="store_true", help="with --base: make the certificates of all machines too")
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="where to (default: ./SITE)")


def run(arguments: argparse.Namespace) -> int:
    """Write them. Raises ConfigError if one is there already, SkyfixError if they cannot be written."""
    site = NewSite(arguments.site, arguments.cameras, arguments.base)
    if arguments.certs and not site.machines:
        raise ConfigError("a bench has no certificates", where="--certs", action="give the base's address: --base")
    makers = _makers() if arguments.certs else None
    folder: Path = arguments.output or Path(site.name)
    files = site.files()
    for name in (*files, AUTHORITY) if makers else (*files,):
        if (folder / name).exists():
            raise ConfigError("is there already", where=str(folder / name), action="give another -o, or remove it")
    try:
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(folder / name, text.encode())
        if makers:
            _certify(makers, site, folder)
    except OSError as error:
        raise SkyfixError(
            f"cannot be written ({error.strerror})", where=str(folder), action="choose another -o"
        ) from error
    for name in files:
        print(f"written {folder / name}")
    print(_what_next(site, folder, certified=arguments.certs))
    return 0


def _makers() -> tuple[Any, Any]:
    """What makes certificates, loaded only here. Raises SkyfixError where its library is not installed."""
    try:
        return tuple(
            importlib.import_module(f"calib.station.{name}") for name in ("certs.of_new_site", "commands.certs")
        )  # type: ignore[return-value]
    except ModuleNotFoundError as error:
        raise SkyfixError(
            f"{error.name} is not installed", where="init --certs", action="pip install 'skyfix[certs]'"
        ) from error


def _certify(makers: tuple[Any, Any], site: NewSite, folder: Path) -> None:
    of_new_site, certs = makers
    of_new_site.certify(site, folder, days=certs.DAYS, now=dt.datetime.now(dt.UTC).replace(microsecond=0))


def _what_next(site: NewSite, folder: Path, *, certified: bool) -> str:
    if not site.machines:
        return "for a bench: base and boxes on this machine. For a field give the base's address with --base."
    if not certified:
        first = (
            "copy each to /etc/skyfix on its machine; then make the certificates (deploy/certs/README.md), or --certs:"
        )
        return "\n".join([first, *(f"  {command}" for command in site.certificates)])
    return (
        f"certificates of all machines: {folder}/certs; keep authority.key off the field machines\n"
        f"on the base: install.sh base --from {folder}; carry to each box its own folder, and there:\n"
        f"  install.sh edge --from {folder / site.camera_ids[0]}"
    )
