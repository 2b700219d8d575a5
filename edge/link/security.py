"""Whether this machine's link is protected: its files, whom its certificate is for, and how long it is good.

A certificate that ends unnoticed silences a box in the middle of a season, and one that was carried to the wrong
machine is refused with no word to whoever shows it. Both stand in its heading and are told here, a month before or at
once. Whoever listens also has the list of all certificates, and tells of each that ends.
"""

import datetime as dt
import os
import stat
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from edge.common.errors import ConfigError
from edge.common.health import Check, HealthLevel
from edge.link.access import Role, load_access
from edge.link.heading import read_heading
from edge.link.settings import LinkSettings, TlsSettings

RENEW_BEFORE: Final = dt.timedelta(days=30)
RENEW: Final = "base-station certs renew"
ISSUE: Final = "base-station certs issue"


@dataclass(frozen=True)
class Bearer:
    """Whom a program's certificate has to be for: its site, what it is, and the cameras it speaks for."""

    site: str
    role: Role
    cameras: tuple[str, ...] = ()


def check_security(settings: LinkSettings, now: dt.datetime, bearer: Bearer | None = None) -> Check:
    """Whether this machine's link is protected, its files are there, and its certificate fits and lasts a month.

    bearer: who the configuration says that this is; None: not compared.
    """
    tls = settings.tls
    if tls is None:
        return Check("security", "warn", settings.warning, "give [link.tls]: see deploy/certs/README.md")
    for file in files_of(settings):
        if not os.access(file, os.R_OK):
            return Check("security", "fail", f"{file} cannot be read", "copy it there: see deploy/certs/README.md")
    if bearer and (wrong := why_not_for(bearer, settings)):
        return Check("security", "fail", wrong, f"copy this machine's own files there, or make them: {ISSUE}")
    if stat.S_IMODE(Path(tls.key).stat().st_mode) & 0o077:
        return Check("security", "warn", f"{tls.key} can be read by others", f"chmod 600 {tls.key}")
    return _check_ends(tls, now)


def files_of(settings: LinkSettings) -> list[Path]:
    """What a protected link reads."""
    tls = settings.tls
    names = [] if tls is None else [tls.authority, tls.certificate, tls.key, tls.access]
    return [Path(name) for name in names if name]


def why_not_for(bearer: Bearer, settings: LinkSettings) -> str:
    """Why the certificate is not this program's; empty if it is, or does not say whose it is."""
    heading = read_heading(Path(settings.tls.certificate)) if settings.tls else None
    if heading is None:
        return ""
    who = f"the certificate {heading.common_name} is for"
    if heading.site not in ("", "*", bearer.site):
        return f"{who} site {heading.site}, this is configured for site {bearer.site}"
    # What a listener may say is not decided by its certificate, but by the list that it holds itself.
    if not settings.connect or not heading.role or bearer.role == "router":
        return ""
    if heading.role != bearer.role:
        return f"{who} a {heading.role}, this is a {bearer.role}"
    unknown = [camera for camera in bearer.cameras if camera not in heading.cameras]
    return f"{who} {', '.join(heading.cameras)}, not for {', '.join(unknown)}" if unknown else ""


def _check_ends(tls: TlsSettings, now: dt.datetime) -> Check:
    heading = read_heading(Path(tls.certificate))
    if heading is None:
        return Check("security", "warn", f"{tls.certificate}: its end is not known", f"make it with `{ISSUE}`")
    soon = [_ending("the certificate", heading.ends, now), _authority_end(tls, now), *_listed_ends(tls, now)]
    return next((check for level in ("fail", "warn") for check in soon if check and check.level == level), None) or (
        Check("security", "ok", f"mutual TLS, certificate good until {heading.ends:%Y-%m-%d}")
    )


def _authority_end(tls: TlsSettings, now: dt.datetime) -> Check | None:
    heading = read_heading(Path(tls.authority))
    if heading is None or heading.ends - now >= RENEW_BEFORE:
        return None
    level: HealthLevel = "fail" if heading.ends <= now else "warn"
    action = "make a new authority in another --folder with `base-station certs init`, and issue everything from it"
    return Check("security", level, f"the authority ends on {heading.ends:%Y-%m-%d}, and everybody with it", action)


def _listed_ends(tls: TlsSettings, now: dt.datetime) -> Iterable[Check]:
    """Of whoever is on the list: who will be turned away within a month, or is already."""
    try:
        subjects = load_access(Path(tls.access)).subjects if tls.access else ()
    except ConfigError as error:
        yield Check("security", "fail", f"{error.where}: {error.what}", error.action)
        return
    ends: dict[str, dt.datetime] = {}
    for subject in subjects:
        if subject.ends is not None:
            ends[subject.name] = max(ends.get(subject.name, subject.ends), subject.ends)
    for name, end in sorted(ends.items(), key=lambda item: item[1]):
        if end - now < RENEW_BEFORE:
            told = "ended" if end <= now else "ends"
            yield Check("security", "warn", f"the certificate of {name} {told} on {end:%Y-%m-%d}", f"{RENEW} {name}")


def _ending(what: str, end: dt.datetime, now: dt.datetime) -> Check | None:
    if end <= now:
        return Check("security", "fail", f"{what} ended on {end:%Y-%m-%d}", RENEW)
    if end - now < RENEW_BEFORE:
        return Check("security", "warn", f"{what} ends on {end:%Y-%m-%d}", RENEW)
    return None


def check_listener_end(where: str, ends: dt.datetime, now: dt.datetime) -> Check | None:
    """A finding if the certificate of whom this program dials ends within a month: it cuts everybody off at once."""
    ending = _ending(f"the certificate of the listener at {where}", ends, now)
    return None if ending is None else Check("listener", ending.level, ending.reason, ending.action)
