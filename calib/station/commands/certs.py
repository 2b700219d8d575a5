"""`base-station certs`: the site's authority and the certificates of its machines. See deploy/certs/README.md."""

import argparse
import datetime as dt
import sys
from pathlib import Path
from typing import Final

from calib.station.certs.authority import Authority
from edge.common.errors import SkyfixError

DAYS: Final = 398  # a season and a winter; a certificate that never ends is never replaced


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station certs`."""
    parser.add_argument("--folder", type=Path, default=Path("certs"), help="the authority's folder (default: ./certs)")
    acts = parser.add_subparsers(required=True)

    init = acts.add_parser("init", help="make the site's authority, once")
    init.add_argument("site")
    init.set_defaults(act=_init)

    issue = acts.add_parser("issue", help="make key and certificate of one machine")
    issue.add_argument("name", help="the camera's id for a box with one camera; any name otherwise")
    issue.add_argument("--role", choices=["camera", "station", "reader", "router"], default="camera")
    issue.add_argument("--camera", action="append", default=[], help="a camera it speaks for; may be repeated")
    issue.add_argument("--address", action="append", default=[], help="host name or IP others dial it by; repeatable")
    issue.add_argument("--site", help="its site, where one authority serves several; '*': may listen to all of them")
    issue.set_defaults(act=_issue)

    renew = acts.add_parser("renew", help="a new key and certificate for a name that has one")
    renew.add_argument("name")
    renew.set_defaults(act=_renew)

    revoke = acts.add_parser("revoke", help="take a name off the list")
    revoke.add_argument("name")
    revoke.set_defaults(act=_revoke)

    for act in (issue, renew):
        act.add_argument("--days", type=int, default=DAYS, help=f"how long it is good (default: {DAYS})")
    acts.add_parser("list", help="who is on the list").set_defaults(act=_list)


def run(arguments: argparse.Namespace) -> int:
    """Do what is asked for; 0 when done. Raises SkyfixError with the reason."""
    try:
        arguments.act(arguments)
    except OSError as error:
        raise SkyfixError(
            f"cannot be read or written ({error})", where=str(arguments.folder), action="check --folder and its rights"
        ) from error
    return 0


def _now() -> dt.datetime:
    return dt.datetime.now(dt.UTC).replace(microsecond=0)


def _init(options: argparse.Namespace) -> None:
    Authority.create(options.folder, options.site, _now())
    print(
        f"{options.folder}: the authority of {options.site}."
        " Keep authority.key off the field machines, and a copy of it safe."
    )


def _issue(options: argparse.Namespace) -> None:
    listens = options.role in ("station", "router")
    if listens and not options.address:
        print("note: without --address nobody can dial this machine, for its name cannot be checked", file=sys.stderr)
    made = Authority(options.folder).issue(
        options.name,
        options.role,
        cameras=tuple(options.camera),
        addresses=tuple(options.address),
        days=options.days,
        now=_now(),
        site=options.site,
    )
    print(f"{made.folder}: copy it to /etc/skyfix/certs on that machine; good until {made.not_after:%Y-%m-%d}")
    print(f"{options.folder / 'access.json'}: copy it to /etc/skyfix/certs where boxes dial in; it is read at start")


def _renew(options: argparse.Namespace) -> None:
    made = Authority(options.folder).renew(options.name, days=options.days, now=_now())
    print(f"{made.folder}: copy it to /etc/skyfix/certs on that machine; good until {made.not_after:%Y-%m-%d}")


def _revoke(options: argparse.Namespace) -> None:
    Authority(options.folder).revoke(options.name)
    print(f"{options.folder / 'access.json'}: copy it to /etc/skyfix/certs where boxes dial in, and restart there")


def _list(options: argparse.Namespace) -> None:
    access = Authority(options.folder).access
    for subject in sorted(access.subjects, key=lambda subject: subject.common_name):
        print(f"{subject.common_name:32} {subject.role:8} until {subject.not_after}  {' '.join(subject.cameras)}")
