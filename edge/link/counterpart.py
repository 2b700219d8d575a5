"""Whether whom this program dials really hears it: the base's token is there, or else why not.

An open session says little. In Zenoh a peer's is open with nobody at the other end, and a certificate that is not on
the list gets a connection on which nothing is ever heard. So the witness is the base's own liveliness token, which only
reaches whom the list lets hear it; while it is missing, a handshake beside Zenoh (handshake.py) asks for the cause.
"""

import datetime as dt
import math
import threading
import time
from typing import Final

from edge.common.health import Check
from edge.common.own_thread import OwnThread
from edge.link.handshake import ALERT_S, DIAL_S, Handshake, shake_hands
from edge.link.link import Link
from edge.link.security import Bearer, check_listener_end, why_not_for

GRACE_S: Final = 4.0  # to meet after a start or a loss: Zenoh dials twice a second, and a base restarts in two
ASK_AGAIN_S: Final = 10.0  # while nobody is met
ASK_MET_S: Final = 6 * 3600.0  # while all is well: only for the end of the listener's certificate
WATCH_S: Final = 0.5


class Counterpart(OwnThread):
    """Watches for the other end of a link that dials. Ask `check` once a second."""

    def __init__(self, link: Link, bearer: Bearer, token: str | None) -> None:
        """token: the key of the liveliness token to look for; None: any connection will do (a router's)."""
        super().__init__("counterpart", DIAL_S)
        self._link = link
        self._bearer = bearer
        self._presence = link.watch_presence(token, 8) if token else None
        self._alive = False
        self._missing_since_s: float | None = None
        self._met = False
        self._handshakes: tuple[Handshake, ...] = ()
        self._shaken_s = -math.inf  # monotonic, when the last of them began
        self._tried = threading.Event()

    def meets(self, timeout_s: float) -> bool:
        """Wait for the other end, or else for the cause; for a program that only looks once."""
        ends_s = time.monotonic() + timeout_s
        while not self._is_met() and time.monotonic() < ends_s:
            self._stop.wait(WATCH_S / 10)
        return self._is_met() or (self._tried.wait(DIAL_S + ALERT_S) and self._is_met())

    def check(self, who: str, now_s: float) -> Check:
        """The finding: who answers, or why nobody does. now_s: monotonic."""
        if self._is_met():
            self._missing_since_s, self._met = None, True
            return Check("link", "ok", f"{who} answers")
        self._met = False
        if self._missing_since_s is None:
            self._handshakes = ()  # what was found while all was well is no cause of this
            self._shaken_s = -math.inf
            self._missing_since_s = now_s
        why = self.why_not(who)
        refused = any(shake.reason and not shake.absent for shake in self._handshakes)
        if not refused and now_s - self._missing_since_s < GRACE_S:
            return Check("link", "warn", f"{who} is being dialled")
        return Check("link", "fail", why.reason, why.action)

    def check_listener(self, now: dt.datetime) -> list[Check]:
        """Whether a listener's certificate is about to end."""
        found = [
            check_listener_end(shake.endpoint, shake.reached.ends, now) for shake in self._handshakes if shake.reached
        ]
        return [check for check in found if check is not None][:1]

    def why_not(self, who: str) -> Handshake:
        """The cause that nobody is met, as well as it is known by now."""
        settings = self._link.settings
        shaken = self._handshakes
        refused = [shake for shake in shaken if shake.reason and not shake.absent]
        if refused:
            return refused[0]
        met = next((shake for shake in shaken if shake.reached), None)
        if self._link.neighbours:
            return self._silent(who, met)
        if met:
            return Handshake(met.endpoint, f"{met.endpoint} answers, but no session comes of it", "look at its log")
        absent = next(iter(shaken), None)
        where = ", ".join(settings.connect)
        reason = absent.reason if absent else self._link.error or f"nobody answers at {where}"
        return Handshake(where, reason, f"check that {who} runs, the network, and link.connect", absent=True)

    def _silent(self, who: str, met: Handshake | None) -> Handshake:
        """Connected, and nothing is heard."""
        where = met.endpoint if met else ", ".join(self._link.settings.connect)
        if wrong := why_not_for(self._bearer, self._link.settings):
            return Handshake(where, f"connected, and nothing is let through: {wrong}", "give it its own certificate")
        listener = met.reached if met else None
        if listener and listener.site not in ("", "*", self._bearer.site):
            reason = f"{where} is of site {listener.site}, this is configured for site {self._bearer.site}"
            return Handshake(where, reason, "correct `site`, or link.connect")
        if listener and listener.role != "router":
            reason = f"{where} lets nothing of this machine through: its list does not have this certificate"
            action = "copy the authority's access.json there; if it was revoked, base-station certs issue a new one"
            return Handshake(where, reason, action)
        reason = f"connected to {where}, and {who} of site {self._bearer.site} is not heard"
        action = "start it, and compare `site`" + ("; or the list there lacks this certificate" if met else "")
        return Handshake(where, reason, action, absent=True)

    def _is_met(self) -> bool:
        neighbours = self._link.neighbours
        if self._presence is None:
            return bool(neighbours)
        for presence in self._presence.drain():
            self._alive = presence.alive
        return self._alive

    def _run(self) -> None:
        settings = self._link.settings
        endpoints = [endpoint for endpoint in settings.connect if endpoint.startswith("tls/")]
        while not self._stop.is_set():
            if time.monotonic() - self._shaken_s >= (ASK_MET_S if self._met else ASK_AGAIN_S):
                self._shaken_s = time.monotonic()
                if settings.tls is not None:
                    self._handshakes = tuple(shake_hands(each, settings.tls, self._stop) for each in endpoints)
                self._tried.set()
            self._stop.wait(WATCH_S)
