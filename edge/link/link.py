"""What a program says and hears over Zenoh, without ever waiting for it.

The session belongs to a thread of its own (edge/link/session.py); the caller only ever leaves a message in a bounded
queue, or looks into an inbox. What is older than a second when its turn comes is thrown away and counted: stale live
data is worthless, and the spool has kept it. Callbacks, which are Zenoh's threads, only enqueue.
"""

import logging
import threading
import time
from types import TracebackType
from typing import Final, Self

import msgspec
import zenoh

from edge import messages
from edge.link.inbox import Inbox, Presence, Received
from edge.link.reception import Reception
from edge.link.request import Request
from edge.link.session import LinkSession
from edge.link.settings import LinkSettings

log = logging.getLogger(__name__)

QUERY_TIMEOUT_S: Final = 2.0
REPLY_GRACE_S: Final = 0.5  # for Zenoh to say that the time is over
GIVE_UP_S: Final = 0.1  # how soon a question is given up
MAX_REPLIES: Final = 2048  # to one question; an honest answer has a dozen, or one per camera


class LinkCounters(msgspec.Struct, frozen=True, kw_only=True):
    """What a link did since it was made; every number only grows."""

    published: int
    dropped: int  # the queue was full: the network is slower than we are
    stale: int  # waited more than a second for a session or a link
    failed: int  # Zenoh refused it
    received: int
    oversize: int  # larger than any honest message
    over_rate: int  # faster than any honest sender
    unanswered: int  # questions for our state, beyond what all together may ask
    open_failures: int


class Link:
    """A Zenoh session with its own thread. Everything may be asked of it before the session is open."""

    def __init__(self, settings: LinkSettings, *, name: str = "link") -> None:
        self.settings = settings
        self._name = name
        self._session = LinkSession(settings, name)
        self._reception = Reception()
        self._states: dict[str, bytes] = {}
        self._states_lock = threading.Lock()
        self._bell = threading.Event()

    def __enter__(self) -> Self:
        if self.settings.warning:
            log.warning("%s: %s", self._name, self.settings.warning)
        self._session.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Send what is waiting, withdraw the tokens and close the session; returns within 2.5 s."""
        self._session.close()

    # What a program says

    def publish(self, key: str, message: msgspec.Struct) -> None:
        """Queue a message for sending; never blocks. The oldest waiting one goes if there is no room."""
        self.publish_bytes(key, messages.encode(message))

    def publish_bytes(self, key: str, payload: bytes) -> None:
        """As `publish`, for a message that is already encoded."""
        self._session.outbox.put(key, payload)

    def set_state(self, key: str, message: msgspec.Struct) -> None:
        """Publish a message that late joiners need too (lens, fix, network): sent on change, answered when asked."""
        payload = messages.encode(message)
        with self._states_lock:
            known = key in self._states
            changed = self._states.get(key) != payload
            self._states[key] = payload
        if not known:
            self._session.request(lambda session: session.declare_queryable(key, self._answer_state))
        if changed:
            self.publish_bytes(key, payload)

    def declare_presence(self, key: str) -> None:
        """Show a liveliness token on this key for as long as the link lives."""
        self._session.request(lambda session: session.liveliness().declare_token(key))

    # What a program hears

    def subscribe(self, key_expr: str, capacity: int = 256) -> Inbox[Received]:
        """Messages on these keys, from now on, in a bounded inbox."""
        inbox: Inbox[Received] = Inbox(capacity, self._bell)
        self._session.request(
            lambda session: session.declare_subscriber(key_expr, lambda sample: self._reception.admit(sample, inbox))
        )
        return inbox

    def watch_state(self, key_expr: str, capacity: int = 256) -> Inbox[Received]:
        """The newest message on each of these keys, now and at every change, whoever started first."""
        inbox: Inbox[Received] = Inbox(capacity, self._bell)
        last: dict[str, bytes] = {}

        def receive(sample: zenoh.Sample) -> None:
            key, payload = str(sample.key_expr), sample.payload.to_bytes()
            if last.get(key) != payload:
                last[key] = payload
                self._reception.admit(sample, inbox)

        def ask(session: zenoh.Session) -> None:
            session.get(
                key_expr,
                lambda reply: receive(reply.ok) if reply.ok is not None else None,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=QUERY_TIMEOUT_S,
            )

        def declare(session: zenoh.Session) -> object:
            self._session.keep_asking(ask)
            token = key_expr.rpartition("/")[0]  # a program's token is its keys' common prefix
            return (
                session.declare_subscriber(key_expr, receive),
                session.liveliness().declare_subscriber(token, lambda _: self._session.ask_states(), history=True),
            )

        self._session.request(declare)
        return inbox

    def watch_presence(self, key_expr: str, capacity: int = 256) -> Inbox[Presence]:
        """Tokens that are there, appear and vanish."""
        inbox: Inbox[Presence] = Inbox(capacity, self._bell)

        def notice(sample: zenoh.Sample) -> None:
            inbox.put(Presence(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT, time.monotonic_ns()))

        self._session.request(lambda session: session.liveliness().declare_subscriber(key_expr, notice, history=True))
        return inbox

    def serve(self, key: str, capacity: int = 32) -> Inbox[Request]:
        """Questions asked of this key, to be answered in the caller's own time."""
        inbox: Inbox[Request] = Inbox(capacity)
        self._session.request(
            lambda session: session.declare_queryable(key, lambda query: inbox.put(Request(key, query)))
        )
        return inbox

    def ask(
        self, selector: str, timeout_s: float = QUERY_TIMEOUT_S, give_up: threading.Event | None = None
    ) -> list[Received]:
        """All replies to a question, at low priority. Blocks up to timeout_s: not for a loop that measures.

        give_up: set by another thread when nobody wants the answer any more.
        """
        replies: Inbox[Received] = Inbox(MAX_REPLIES)
        done = threading.Event()

        def receive(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._reception.admit(reply.ok, replies)

        def get(session: zenoh.Session) -> None:
            session.get(
                selector,
                zenoh.handlers.Callback(receive, done.set),
                consolidation=zenoh.ConsolidationMode.NONE,  # by default several replies on one key collapse to one
                priority=zenoh.Priority.DATA_LOW,  # replies inherit it: what is late must not delay what is live
                timeout=timeout_s,
            )

        self._session.request(get)
        ends_s = time.monotonic() + timeout_s + REPLY_GRACE_S
        while not done.wait(GIVE_UP_S) and time.monotonic() < ends_s and not (give_up and give_up.is_set()):
            pass
        return replies.drain()

    @property
    def bell(self) -> threading.Event:
        """Rung at every arrival; for inboxes that others fill beside the link's own."""
        return self._bell

    def wait(self, timeout_s: float) -> bool:
        """Wait until something arrived in any inbox since the last call; False after timeout_s without."""
        rung = self._bell.wait(timeout_s)
        self._bell.clear()
        return rung

    # How it is

    def wait_open(self, timeout_s: float) -> bool:
        """Whether the session is open, waiting up to timeout_s for it. No loop needs this; tools and tests do."""
        return self._session.opened.wait(timeout_s)

    @property
    def warning(self) -> str:
        """That nothing is protected, if so; for health. Empty with the production profile."""
        return self.settings.warning

    @property
    def error(self) -> str:
        """Why the session is not open; empty once it is."""
        return self._session.error

    @property
    def neighbours(self) -> int | None:
        """How many others the session was connected to when this was last asked; None before the first answer."""
        return self._session.neighbours()

    @property
    def counters(self) -> LinkCounters:
        """What this link did so far."""
        session = self._session
        return LinkCounters(
            published=session.published,
            dropped=session.outbox.dropped,
            stale=session.outbox.stale,
            failed=session.failed,
            open_failures=session.open_failures,
            **msgspec.structs.asdict(self._reception.counters),
        )

    # Zenoh's threads: they only put

    def _answer_state(self, query: zenoh.Query) -> None:
        if not self._reception.admit_question():
            with query:  # ended without an answer: who asks so often asks again
                return
        with self._states_lock:
            states = dict(self._states)
        with query:
            for key, payload in states.items():
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, payload, encoding=messages.ENCODING)
