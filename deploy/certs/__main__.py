"""The site's certificates on the command line: `python deploy/certs init|issue|renew|revoke|list`. See README.md."""

import argparse
import datetime as dt
import sys
from pathlib import Path
from typing import Final

from authority import Authority

from edge.errors import SkyfixError

DAYS: Final = 398  # a season and a winter; a certificate that never ends is never replaced


def main(arguments: list[str] | None = None) -> int:
    """The command line; 0 done, 1 it could not be done, 2 wrong usage."""
    options = _parser().parse_args(arguments)
    try:
        options.act(options)
    except (SkyfixError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="deploy/certs", description="Who belongs to a site: its certificates.")
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
    return parser


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


if __name__ == "__main__":
    sys.exit(main())
