"""The door for what comes from the network: nothing larger or faster than an honest sender's gets in.

A sender that has gone mad, or was never honest, must cost little: what is over its rate or size is dropped before it is
decoded, and counted. Each key has its own allowance, so one camera's flood takes nothing from another.
"""

import threading
import time
from typing import Final

import msgspec
import zenoh

from edge.common.allowances import Allowances
from edge.link.inbox import Inbox, Received
from edge.link.profile import MAX_MESSAGE_BYTES

MAX_RATE_HZ: Final = 1000.0  # messages a second and key: a 30 Hz recording played at 30 times its speed
BURST: Final = 2000.0  # messages a key may send at once: what a link held back while it was cut
QUESTIONS_HZ: Final = 100.0  # for late joiners' state, from all: a hundred boxes ask once in five seconds each
QUESTIONS_BURST: Final = 400.0  # all of them at once, after a base has started anew


class ReceptionCounters(msgspec.Struct, frozen=True, kw_only=True):
    """What came in so far; every number only grows."""

    received: int = 0
    oversize: int = 0  # larger than any honest message
    over_rate: int = 0  # faster than any honest sender
    unanswered: int = 0  # questions beyond what all together may ask


class Reception:
    """Admits samples to inboxes. Called from Zenoh's threads: it only counts and puts."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._allowances = Allowances(MAX_RATE_HZ, BURST)
        self._questions = Allowances(QUESTIONS_HZ, QUESTIONS_BURST)
        self._received = self._oversize = self._over_rate = self._unanswered = 0

    def admit(self, sample: zenoh.Sample, inbox: Inbox[Received]) -> None:
        """Put a sample into an inbox, or drop and count it."""
        key, size = str(sample.key_expr), len(sample.payload)
        with self._lock:
            if size > MAX_MESSAGE_BYTES:
                self._oversize += 1
                return
            if not self._allowances.take(key, time.monotonic()):
                self._over_rate += 1
                return
            self._received += 1
        inbox.put(Received(key, sample.payload.to_bytes(), time.monotonic_ns()))

    def admit_question(self) -> bool:
        """Whether a question about our state is answered; one that is not is counted."""
        with self._lock:
            admitted = self._questions.take("", time.monotonic())
            self._unanswered += not admitted
            return admitted

    @property
    def counters(self) -> ReceptionCounters:
        """What came in so far."""
        with self._lock:
            return ReceptionCounters(
                received=self._received,
                oversize=self._oversize,
                over_rate=self._over_rate,
                unanswered=self._unanswered,
            )
