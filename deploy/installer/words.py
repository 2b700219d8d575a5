"""The command line of install.sh."""

import argparse
import re
from pathlib import Path
from typing import Final

from .changeover import WATCHED_S
from .places import ROLES
from .telling import RefusedError

NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")  # as in a Zenoh key
ADDRESS: Final = re.compile(r"[0-9A-Za-z.:-]+")


def parse(words: list[str]) -> argparse.Namespace:
    """What is wanted. Raises RefusedError (code 2) for a name or address that is none."""
    parser = argparse.ArgumentParser(prog="install.sh", description="Install, upgrade or remove Skyfix; as root.")
    acts = parser.add_subparsers(dest="act", required=True, metavar="|".join([*ROLES, "rollback", "uninstall"]))
    for role in ROLES.values():
        act = acts.add_parser(role.name, help=f"install or upgrade {role.unit}")
        act.add_argument("--offline", type=Path, metavar="BUNDLE", help="a bundle elsewhere, a folder or its .tar")
        act.add_argument("--signers", type=Path, metavar="FILE", help="who may sign a bundle (ssh allowed signers)")
        act.add_argument(
            "--unsigned", action="store_true", help="take a bundle that the machine's signers did not sign"
        )
        act.add_argument("--no-start", action="store_true", help="lay everything, start nothing")
        act.add_argument("--watch", type=float, default=WATCHED_S, metavar="S", help="how long an upgrade is watched")
        _add_site(act)
    back = acts.add_parser("rollback", help="back to the version before")
    back.add_argument("--watch", type=float, default=WATCHED_S, metavar="S", help="how long it is watched")
    remove = acts.add_parser("uninstall", help="remove the programs")
    remove.add_argument("--purge", action="store_true", help="and configuration and everything recorded")
    wanted = parser.parse_args(words)
    for option, rule in (("site", NAME), ("camera", NAME), ("base", ADDRESS)):
        value = getattr(wanted, option, None)
        if value is not None and not rule.fullmatch(value):
            raise RefusedError(f"--{option} {value!r} cannot be one", f"use {rule.pattern}", 2)
    if getattr(wanted, "time", "") is None:
        # Boxes follow their base, so one that they dial serves them the time.
        wanted.time = "ntp" if wanted.act == "base" and wanted.base else "none"
    return wanted


def _add_site(act: argparse.ArgumentParser) -> None:
    """What a machine is at which site; for a configuration that is not there yet."""
    act.add_argument("--site", help="the site's name, for a configuration that is not there yet")
    act.add_argument("--cameras", type=int, default=3, metavar="N", help="base: how many the site has (default: 3)")
    act.add_argument("--camera", metavar="ID", help="edge: the camera's id")
    act.add_argument("--base", metavar="ADDRESS", help="the base's address, as the boxes dial it")
    act.add_argument(
        "--from",
        dest="carried",
        type=Path,
        metavar="FOLDER",
        help="this machine's part of a site: configuration, certificates, lens",
    )
    act.add_argument(
        "--time",
        choices=["pps", "ntp", "none"],
        help="base: serve the site's time (default: with --base ntp)",
    )
