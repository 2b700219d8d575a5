"""The site's router, where there is one, as the base hears it: what it says of itself, and whether it still says so.

The hazard is a machine without a screen: a router whose certificate ends, or that has lost the one above it, goes on
routing, and nobody looks at its journal. No position waits for it: whether the base is connected, the link tells.
"""

import time
from typing import Final

from edge.common.errors import MessageError
from edge.common.health import SEVERITY, Check
from edge.link.inbox import Inbox, Received
from edge.messages import Health, decode

NAME: Final = "router"
ROUTER_SILENT_S: Final = 10.0  # it speaks every second
LOOK: Final = "look at it: journalctl -u skyfix-router"


class RouterWatch:
    """Keeps what the router said last. inbox: of its health."""

    def __init__(self, inbox: Inbox[Received]) -> None:
        self._inbox = inbox
        self._last: Received | None = None

    def checks(self, now_ns: int | None = None) -> list[Check]:
        """How it is; nothing where no router was ever heard. now_ns: monotonic."""
        for message in self._inbox.drain():
            self._last = message
        if self._last is None:
            return []
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        silent_s = (now_ns - self._last.t_monotonic_ns) * 1e-9
        if silent_s > ROUTER_SILENT_S:
            return [Check(NAME, "warn", f"the router has not been heard for {silent_s:.0f} s", LOOK)]
        return [_judged(self._last.payload)]


def _judged(payload: bytes) -> Check:
    """The worst thing that it says of itself, as a warning at most."""
    try:
        health = decode(payload, Health, where=NAME)
    except MessageError as error:
        return Check(NAME, "warn", f"the router says what cannot be read: {error}", LOOK)
    ill = sorted((item for item in health.items if item.level != "ok"), key=lambda item: -SEVERITY[item.level])
    if not ill:
        return Check(NAME, "ok", f"the router (version {health.version or 'unknown'}) finds no fault with itself")
    return Check(NAME, "warn", f"the router's {ill[0].name}: {ill[0].reason}", ill[0].action or LOOK)
