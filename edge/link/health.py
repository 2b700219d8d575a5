"""How the link is, for health: is there a session, is it protected, was anybody turned away, is anything lost.

What the library does not tell is gathered here: refusals from its log, the certificate's end from the heading that
`base-station certs` writes above it. A certificate that ends unnoticed silences a box in the middle of a season.
"""

import datetime as dt
import os
import stat
import time
from pathlib import Path
from typing import Final

import msgspec

from edge.common.health import Check
from edge.link import zenoh_log
from edge.link.link import Link, LinkCounters
from edge.link.settings import LinkSettings, TlsSettings

RECENT_S: Final = 60.0  # how long a refusal or a loss is spoken of
RENEW_BEFORE: Final = dt.timedelta(days=30)
HEADING_BYTES: Final = 200


class LinkHealth:
    """Watches one link. Call `checks` once a second or so."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._refused = self._lost = 0
        self._refused_s = self._lost_s = -RECENT_S

    def checks(self, *, who: str, now_s: float | None = None) -> list[Check]:
        """One finding each. who: whom this link should reach, for the advice. now_s: monotonic."""
        now = time.monotonic() if now_s is None else now_s
        return [self._session(who), self._security(), self._refusals(now), self._losses(now)]

    def counters(self) -> dict[str, float]:
        """What the link did so far, by name; every number only grows."""
        refusals = zenoh_log.refusals()
        counted = {f"link_{name}": float(count) for name, count in msgspec.structs.asdict(self._link.counters).items()}
        return counted | {
            "link_refused_handshakes": float(refusals.handshakes),
            "link_refused_messages": float(refusals.messages),
        }

    def _session(self, who: str) -> Check:
        if self._link.error:
            return Check("link", "fail", self._link.error, f"check [link] and that {who} can be reached")
        return Check("link", "ok", "the session is open")

    def _security(self) -> Check:
        return check_security(self._link.settings, dt.datetime.now(dt.UTC))

    def _refusals(self, now_s: float) -> Check:
        refusals = zenoh_log.refusals()
        total = refusals.handshakes + refusals.messages
        if total > self._refused:
            self._refused, self._refused_s = total, now_s
        if now_s - self._refused_s >= RECENT_S:
            return Check("refused", "ok", "nobody was turned away")
        reason = f"{refusals.handshakes} connections and {refusals.messages} messages were turned away"
        last = f" (last: {refusals.last_reason})" if refusals.last_reason else ""
        return Check("refused", "warn", reason + last, "a box of yours needs a new certificate, or somebody is trying")

    def _losses(self, now_s: float) -> Check:
        lost = _lost(self._link.counters)
        if lost > self._lost:
            self._lost, self._lost_s = lost, now_s
        if now_s - self._lost_s >= RECENT_S:
            return Check("network", "ok", "takes what is sent")
        reason = f"{lost} live messages were not sent in time"
        return Check("network", "warn", reason, "they reach the recording later; look at the link's signal and load")


def _lost(counters: LinkCounters) -> int:
    return counters.dropped + counters.stale + counters.failed


def check_security(settings: LinkSettings, now: dt.datetime) -> Check:
    """Whether this machine's link is protected, its files are there and its certificate is good for a month."""
    tls = settings.tls
    if tls is None:
        return Check("security", "warn", settings.warning, "give [link.tls]: see deploy/certs/README.md")
    for file in (tls.authority, tls.certificate, tls.key, *([tls.access] if tls.access else [])):
        if not os.access(file, os.R_OK):
            return Check("security", "fail", f"{file} cannot be read", "copy it there: see deploy/certs/README.md")
    if stat.S_IMODE(Path(tls.key).stat().st_mode) & 0o077:
        return Check("security", "warn", f"{tls.key} can be read by others", f"chmod 600 {tls.key}")
    return _check_certificate(tls, now)


def _check_certificate(tls: TlsSettings, now: dt.datetime) -> Check:
    end = certificate_end(Path(tls.certificate))
    if end is None:
        return Check(
            "security", "warn", f"{tls.certificate}: its end is not known", "make it with `base-station certs issue`"
        )
    if end <= now:
        return Check("security", "fail", f"the certificate ended on {end:%Y-%m-%d}", "base-station certs renew")
    if end - now < RENEW_BEFORE:
        return Check("security", "warn", f"the certificate ends on {end:%Y-%m-%d}", "base-station certs renew")
    return Check("security", "ok", f"mutual TLS, certificate good until {end:%Y-%m-%d}")


def certificate_end(file: Path) -> dt.datetime | None:
    """When a certificate made by `base-station certs` ends, from its heading; None if it cannot be told."""
    try:
        with file.open("rb") as opened:
            heading = opened.read(HEADING_BYTES).decode(errors="replace")
        expiry = next(line for line in heading.splitlines() if line.startswith("expires "))
        end = dt.datetime.fromisoformat(expiry.removeprefix("expires "))
    except (OSError, StopIteration, ValueError):
        return None
    return end if end.tzinfo else end.replace(tzinfo=dt.UTC)
