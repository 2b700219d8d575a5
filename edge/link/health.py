"""How the link is, for health: does anybody hear us, is it protected, was anybody turned away, is anything lost.

What the library does not tell is gathered here: refusals from its log, the certificate from its heading (security.py),
and from a program that dials, whether whom it dials is there and lets it speak (counterpart.py).
"""

import datetime as dt
import time
from contextlib import ExitStack
from typing import Final, Self

import msgspec

from edge.common.health import Check
from edge.link import zenoh_log
from edge.link.counterpart import Counterpart
from edge.link.link import Link, LinkCounters
from edge.link.security import Bearer, check_security

RECENT_S: Final = 60.0  # how long a refusal or a loss is spoken of


class LinkHealth:
    """Watches one link while it is entered. Call `checks` once a second or so."""

    def __init__(self, link: Link, bearer: Bearer, token: str | None = None) -> None:
        """bearer: whom our certificate has to be for. token: of whom we dial, its liveliness token's key."""
        self._link = link
        self._bearer = bearer
        self._counterpart = Counterpart(link, bearer, token) if link.settings.connect else None
        self._resources = ExitStack()
        self._refused = self._lost = 0
        self._refused_s = self._lost_s = -RECENT_S

    def __enter__(self) -> Self:
        if self._counterpart:
            self._resources.enter_context(self._counterpart)
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def ask_to_stop(self) -> None:
        """Tell it to end and do not wait."""
        if self._counterpart:
            self._counterpart.ask_to_stop()

    def checks(self, *, who: str, now_s: float | None = None) -> list[Check]:
        """One finding each. who: whom this link should reach, for the advice. now_s: monotonic."""
        now = time.monotonic() if now_s is None else now_s
        today = dt.datetime.now(dt.UTC)
        found = [self._session(who, now), check_security(self._link.settings, today, self._bearer)]
        found += self._counterpart.check_listener(today) if self._counterpart else []
        return [*found, self._refusals(now), self._losses(now)]

    def counters(self) -> dict[str, float]:
        """What the link did so far, by name; every number only grows."""
        refusals = zenoh_log.refusals()
        counted = {f"link_{name}": float(count) for name, count in msgspec.structs.asdict(self._link.counters).items()}
        return counted | {
            "link_refused_handshakes": float(refusals.handshakes),
            "link_refused_messages": float(refusals.messages),
        }

    def _session(self, who: str, now_s: float) -> Check:
        if self._counterpart:
            return self._counterpart.check(who, now_s)
        if self._link.error:
            return Check("link", "fail", self._link.error, f"check [link] and that {who} can be reached")
        return Check("link", "ok", "the session is open")

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
