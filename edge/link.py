"""One Zenoh session, kept away from the loop that must not wait for it.

Opening a session, declaring on it and even `put` can block for seconds when a link hangs. Here one thread of our own
does all of that; the caller only ever leaves a message in a bounded queue. What is older than a second when its turn
comes is thrown away and counted: stale live data is worthless, and the spool has kept it. Callbacks only enqueue. A
session that is not closed hangs the process at exit, so a Link is a context manager.
"""

import logging
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Final, Self

import msgspec
import zenoh

from edge import messages
from edge.errors import ConfigError
from edge.inbox import Inbox, Presence, Received
from edge.link_profile import LinkSettings, zenoh_config
from edge.outbox import Outbox, Outgoing
from edge.reception import Reception
from edge.request import Request

log = logging.getLogger(__name__)

REOPEN_S: Final = 0.5  # between attempts to open a session
STATE_POLL_S: Final = 5.0  # how often late-joiner state is asked for, beside every arrival
QUERY_TIMEOUT_S: Final = 2.0
REPLY_GRACE_S: Final = 0.5  # for Zenoh to say that the time is over
GIVE_UP_S: Final = 0.1  # how soon a question is given up
MAX_REPLIES: Final = 2048  # to one question; an honest answer has a dozen, or one per camera
CLOSE_S: Final = 2.5  # the share of the 3 s shutdown budget that closing may take

_SOURCE_PLACE: Final = re.compile(r"\s+at /\S+\.rs:\d+\.?")  # where in its own source the library was
_URGENT_TOPICS: Final = ("tracks", "targets")


class LinkCounters(msgspec.Struct, frozen=True, kw_only=True):
    """What a link did since it was made; every number only grows."""

    published: int
    dropped: int  # the queue was full: the network is slower than we are
    stale: int  # waited more than a second for a session or a link
    failed: int  # Zenoh refused it
    received: int
    oversize: int  # larger than any honest message
    over_rate: int  # faster than any honest sender
    open_failures: int


class Link:
    """A Zenoh session with its own thread. Everything may be asked of it before the session is open."""

    def __init__(self, settings: LinkSettings, *, name: str = "link") -> None:
        self.settings = settings
        self._name = name
        self._lock = threading.Condition()
        self._outbox = Outbox(self._lock)
        self._reception = Reception()
        self._wishes: deque[Callable[[zenoh.Session], object]] = deque()  # what to declare, in order
        self._declared: list[object] = []  # a token or queryable without a reference is dropped at once
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._states: dict[str, bytes] = {}
        self._state_watchers: list[Callable[[zenoh.Session], object]] = []
        self._states_due = 0.0
        self._bell = threading.Event()
        self._opened = threading.Event()
        self._stopping = False
        self._published = self._failed = self._open_failures = 0
        self._error = ""
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        if self.settings.warning:
            log.warning("%s: %s", self._name, self.settings.warning)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Send what is waiting, withdraw the tokens and close the session; returns within 2.5 s."""
        with self._lock:
            self._stopping = True
            self._lock.notify_all()
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)
            if self._thread.is_alive():
                log.warning(
                    "%s: the Zenoh session did not close within %.1f s; left to the process's end", self._name, CLOSE_S
                )

    # What a program says

    def publish(self, key: str, message: msgspec.Struct) -> None:
        """Queue a message for sending; never blocks. The oldest waiting one goes if there is no room."""
        self.publish_bytes(key, messages.encode(message))

    def publish_bytes(self, key: str, payload: bytes) -> None:
        """As `publish`, for a message that is already encoded."""
        self._outbox.put(key, payload)

    def set_state(self, key: str, message: msgspec.Struct) -> None:
        """Publish a message that late joiners need too (lens, fix, network): sent on change, answered when asked."""
        payload = messages.encode(message)
        with self._lock:
            known = key in self._states
            changed = self._states.get(key) != payload
            self._states[key] = payload
        if not known:
            self._wish(lambda session: session.declare_queryable(key, self._answer_state))
        if changed:
            self.publish_bytes(key, payload)

    def declare_presence(self, key: str) -> None:
        """Show a liveliness token on this key for as long as the link lives."""
        self._wish(lambda session: session.liveliness().declare_token(key))

    # What a program hears

    def subscribe(self, key_expr: str, capacity: int = 256) -> Inbox[Received]:
        """Messages on these keys, from now on, in a bounded inbox."""
        inbox: Inbox[Received] = Inbox(capacity, self._bell)
        self._wish(
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
            self._state_watchers.append(ask)
            token = key_expr.rpartition("/")[0]  # a program's token is its keys' common prefix
            return (
                session.declare_subscriber(key_expr, receive),
                session.liveliness().declare_subscriber(token, lambda _: self._ask_states(), history=True),
            )

        self._wish(declare)
        return inbox

    def watch_presence(self, key_expr: str, capacity: int = 256) -> Inbox[Presence]:
        """Tokens that are there, appear and vanish."""
        inbox: Inbox[Presence] = Inbox(capacity, self._bell)

        def notice(sample: zenoh.Sample) -> None:
            inbox.put(Presence(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT, time.monotonic_ns()))

        self._wish(lambda session: session.liveliness().declare_subscriber(key_expr, notice, history=True))
        return inbox

    def serve(self, key: str, capacity: int = 32) -> Inbox[Request]:
        """Questions asked of this key, to be answered in the caller's own time."""
        inbox: Inbox[Request] = Inbox(capacity)
        self._wish(lambda session: session.declare_queryable(key, lambda query: inbox.put(Request(key, query))))
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

        self._wish(get)
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
        return self._opened.wait(timeout_s)

    @property
    def warning(self) -> str:
        """That nothing is protected, if so; for health. Empty with the production profile."""
        return self.settings.warning

    @property
    def error(self) -> str:
        """Why the session is not open; empty once it is."""
        return self._error

    @property
    def counters(self) -> LinkCounters:
        """What this link did so far."""
        with self._lock:
            return LinkCounters(
                published=self._published,
                dropped=self._outbox.dropped,
                stale=self._outbox.stale,
                failed=self._failed,
                open_failures=self._open_failures,
                **msgspec.structs.asdict(self._reception.counters),
            )

    # Zenoh's threads: they only put

    def _answer_state(self, query: zenoh.Query) -> None:
        with self._lock:
            states = dict(self._states)
        with query:
            for key, payload in states.items():
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, payload, encoding=messages.ENCODING)

    def _ask_states(self) -> None:
        with self._lock:
            self._states_due = 0.0
            self._lock.notify_all()

    # Our thread: the only one that talks to the session

    def _wish(self, declare: Callable[[zenoh.Session], object]) -> None:
        with self._lock:
            self._wishes.append(declare)
            self._lock.notify_all()

    def _run(self) -> None:
        session = self._open()
        if session is None:
            return
        try:
            while self._step(session):
                pass
        finally:
            self._declared.clear()
            self._publishers.clear()
            session.close()  # type: ignore[no-untyped-call]

    def _open(self) -> zenoh.Session | None:
        while not self._stopping:
            try:
                session = zenoh.open(zenoh_config(self.settings))
            except (zenoh.ZError, ConfigError) as error:
                self._note_failure(error)
                with self._lock:
                    self._lock.wait_for(lambda: self._stopping, REOPEN_S)
            else:
                self._error = ""
                self._opened.set()
                return session
        return None

    def _note_failure(self, error: Exception) -> None:
        with self._lock:
            self._open_failures += 1
        said = _SOURCE_PLACE.sub("", str(error))
        if self._error != said:
            log.warning("%s: no session (%s); trying again every %.1f s", self._name, said, REOPEN_S)
        self._error = said

    def _step(self, session: zenoh.Session) -> bool:
        with self._lock:
            self._lock.wait_for(self._has_work, self._patience_s())
            wishes, outgoing, stopping = list(self._wishes), self._outbox.take(), self._stopping
            self._wishes.clear()
        for declare in wishes:
            if (declared := declare(session)) is not None:
                self._declared.append(declared)
        for item in outgoing:
            self._send(session, item)
        if self._patience_s() == 0:
            self._states_due = time.monotonic() + STATE_POLL_S
            for ask in self._state_watchers:
                ask(session)
        return not stopping

    def _has_work(self) -> bool:
        return bool(self._stopping or self._wishes or self._outbox or self._patience_s() == 0)

    def _patience_s(self) -> float | None:
        """How long until somebody's state must be asked for; None if nobody watches any."""
        return max(0.0, self._states_due - time.monotonic()) if self._state_watchers else None

    def _send(self, session: zenoh.Session, item: Outgoing) -> None:
        try:
            self._publisher(session, item.key).put(item.payload)
        except zenoh.ZError as error:
            log.debug("%s: %s not sent (%s)", self._name, item.key, error)
            self._failed += 1
        else:
            self._published += 1

    def _publisher(self, session: zenoh.Session, key: str) -> zenoh.Publisher:
        if key not in self._publishers:
            urgent = key.rpartition("/")[2] in _URGENT_TOPICS
            self._publishers[key] = session.declare_publisher(
                key,
                encoding=messages.ENCODING,
                congestion_control=zenoh.CongestionControl.DROP,  # BLOCK was measured to block put() for 5 s
                priority=zenoh.Priority.DATA_HIGH if urgent else zenoh.Priority.DATA,
                express=False,
            )
        return self._publishers[key]
