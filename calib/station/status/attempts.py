"""Wrong tokens: each makes the next attempt from the same address wait longer, and all are counted. Pure.

The hazard is the patient stranger: a token of sixteen characters that somebody thought up is found by fifteen hundred
attempts a second, and by a hundred a day it is not. Whoever has looked before carries a session that nobody guesses, so
those who know are let in meanwhile from the same address.
"""

from collections import OrderedDict
from dataclasses import dataclass
from ipaddress import IPv6Address, ip_address
from typing import Final

import msgspec

from calib.station.status.status import StationStatus
from edge.common.health import worst
from edge.messages import HealthItem

FREE_ATTEMPTS: Final = 5  # attempts: a mistyped token, a tablet with last year's
FIRST_WAIT_S: Final = 1.0  # then twice as long each time
LONGEST_WAIT_S: Final = 300.0
FORGOTTEN_S: Final = 3600.0  # without an attempt
WHO_TRIES: Final = "find out who it is; if the token may be known, write another into status.token_file and restart"
MOST_REMEMBERED: Final = 1000  # addresses; the oldest is forgotten first
NETWORK_BITS: Final = 64  # of IPv6: one machine has that many addresses to itself
SPOKEN_OF_S: Final = 600.0  # for how long wrong tokens are spoken of


@dataclass
class _Tried:
    count: int
    last_s: float


class Attempts:
    """What was tried, by address. wrong: tokens that were none; waited: attempts that were not even looked at."""

    def __init__(self) -> None:
        self._tried: OrderedDict[str, _Tried] = OrderedDict()
        self._last: tuple[str, float] | None = None
        self.since_s = 0.0  # when the first of those that are spoken of came
        self.wrong = 0
        self.waited = 0

    def may(self, address: str, now_s: float) -> bool:
        """Whether a token from this address is looked at now; if not, that is counted."""
        tried = self._tried.get(_one(address))
        if tried is None or now_s - tried.last_s > FORGOTTEN_S or tried.count < FREE_ATTEMPTS:
            return True
        wait_s = min(FIRST_WAIT_S * 2.0 ** (tried.count - FREE_ATTEMPTS), LONGEST_WAIT_S)
        if now_s - tried.last_s >= wait_s:
            return True
        self.waited += 1
        self._note(address, now_s)
        return False

    def failed(self, address: str, now_s: float) -> None:
        """A token from this address was wrong."""
        self.wrong += 1
        self._note(address, now_s)
        name = _one(address)
        tried = self._tried.pop(name, None)
        fresh = tried is None or now_s - tried.last_s > FORGOTTEN_S
        self._tried[name] = _Tried(1 if tried is None or fresh else min(tried.count + 1, 60), now_s)
        while len(self._tried) > MOST_REMEMBERED:
            self._tried.popitem(last=False)

    def _note(self, address: str, now_s: float) -> None:
        if not self.told(now_s):
            self.since_s = now_s
        self._last = address, now_s

    def told(self, now_s: float) -> str:
        """That somebody tries tokens, in words; empty if nobody lately does."""
        if self._last is None or now_s - self._last[1] > SPOKEN_OF_S:
            return ""
        return f"{self.wrong} wrong tokens and {self.waited} attempts that had to wait, the last from {self._last[0]}"


def _one(address: str) -> str:
    """What counts as one: an IPv4 address, an IPv6 network."""
    try:
        parsed = ip_address(address)
    except ValueError:
        return address
    if isinstance(parsed, IPv6Address):
        return str(IPv6Address(int(parsed) >> (128 - NETWORK_BITS) << (128 - NETWORK_BITS)))
    return address


def with_door(status: StationStatus, attempts: Attempts, turned_away: int, now_s: float) -> StationStatus:
    """A status with what is known at the door: who tries tokens, and how many connections were ended."""
    counters = {"wrong_tokens": attempts.wrong, "token_attempts_waited": attempts.waited, "turned_away": turned_away}
    told = attempts.told(now_s)
    items = list(status.health.items)
    if told:
        items.append(
            HealthItem(
                name="token", level="warn", since_unix_ns=int(attempts.since_s * 1e9), reason=told, action=WHO_TRIES
            )
        )
    level = worst([status.health.level, "warn"]) if told else status.health.level
    health = msgspec.structs.replace(status.health, items=items, level=level)
    return msgspec.structs.replace(status, health=health, counters=status.counters | counters)
