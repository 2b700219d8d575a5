"""The thread that owns a Zenoh session: nobody else opens it, declares on it, puts into it or closes it.

Opening, declaring and even `put` can block for seconds when a link hangs, and a session that is not closed hangs the
process at its end. So the session lives here, with a queue of requests and one of messages before it: whoever leaves
something in them goes on at once. The library gives every callback a thread, and these outlive the session by an
instant: one that is still in it when the interpreter goes away aborts the process, so they are waited for.
"""

import logging
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import zenoh

from edge import messages
from edge.common.errors import ConfigError
from edge.common.own_thread import OwnThread
from edge.link.outbox import Outbox, OutgoingMessage
from edge.link.profile import zenoh_config
from edge.link.settings import LinkSettings

log = logging.getLogger(__name__)

REOPEN_S: Final = 0.5  # between attempts to open a session
STATE_POLL_S: Final = 5.0  # how often late-joiner state is asked for, beside every arrival
SESSION_CLOSE_S: Final = 2.5  # the share of the 3 s shutdown budget that closing may take

_SOURCE_PLACE: Final = re.compile(r"\s+at /\S+\.rs:\d+\.?")  # where in its own source the library was
_URGENT_TOPICS: Final = ("tracks", "targets")

CALLBACK_THREAD: Final = "pyo3-closure"  # in the names that the library's threads get
CALLBACKS_END_S: Final = 1.0  # once the session is closed; they take milliseconds unless the machine is very busy

Declare = Callable[[zenoh.Session], object]


class LinkSession(OwnThread):
    """One session, opened as soon as it can be and kept until the end. Any thread may request and send, at any time.

    Closing it sends what is waiting, withdraws the tokens and closes the session.
    """

    def __init__(self, settings: LinkSettings, name: str) -> None:
        super().__init__(name, SESSION_CLOSE_S)
        self._settings = settings
        self._changed = threading.Condition()
        self.outbox = Outbox(self._changed)
        self._requests: deque[Declare] = deque()  # what to declare, in order
        self._declared: list[object] = []  # a token or queryable without a reference is dropped at once
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._callbacks: list[threading.Thread] = []
        self._state_watchers: list[Declare] = []
        self._states_due = 0.0
        self._neighbours: int | None = None
        self._counting = False
        self.opened = threading.Event()
        self.published = self.failed = self.open_failures = 0
        self.error = ""

    def request(self, declare: Declare) -> None:
        """Do this with the session, once it is open; what it returns is kept for as long as the session."""
        with self._changed:
            self._requests.append(declare)
            self._changed.notify_all()

    def keep_asking(self, ask: Declare) -> None:
        """Ask for somebody's state now and then, and whenever `ask_states` is called. Only from within a request."""
        self._state_watchers.append(ask)

    def ask_states(self) -> None:
        """Ask for everybody's state now; any thread may call it."""
        with self._changed:
            self._states_due = 0.0
            self._changed.notify_all()

    def neighbours(self) -> int | None:
        """The last count of those it is connected to, and a request for the next; None before the first."""
        if not self._counting:
            self._counting = True
            self.request(self._count_neighbours)
        return self._neighbours

    # The thread

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()

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
            deadline = time.monotonic() + CALLBACKS_END_S
            for thread in self._callbacks:
                thread.join(max(0.0, deadline - time.monotonic()))

    def _open(self) -> zenoh.Session | None:
        while not self._stop.is_set():
            try:
                session = zenoh.open(zenoh_config(self._settings))
            except (zenoh.ZError, ConfigError) as error:
                self._note_failure(error)
                self._stop.wait(REOPEN_S)
            else:
                self.error = ""
                self.opened.set()
                return session
        return None

    def _note_failure(self, error: Exception) -> None:
        self.open_failures += 1
        reason = _SOURCE_PLACE.sub("", str(error))
        if self.error != reason:
            log.warning("%s: no session (%s); trying again every %.1f s", self._name, reason, REOPEN_S)
        self.error = reason

    def _step(self, session: zenoh.Session) -> bool:
        with self._changed:
            self._changed.wait_for(self._has_work, self._patience_s())
            requests, outgoing, stopping = list(self._requests), self.outbox.take(), self._stop.is_set()
            self._requests.clear()
        for declare in requests:
            if (declared := self._do(declare, session)) is not None:
                self._declared.append(declared)
        for item in outgoing:
            self._send(session, item)
        if self._patience_s() == 0:
            self._states_due = time.monotonic() + STATE_POLL_S
            for ask in self._state_watchers:
                self._do(ask, session)
        return not stopping

    def _do(self, declare: Declare, session: zenoh.Session) -> object:
        """Do it, and remember the threads that the library starts for it."""
        before = set(threading.enumerate())
        declared = declare(session)
        new = [thread for thread in threading.enumerate() if thread not in before and CALLBACK_THREAD in thread.name]
        self._callbacks = [thread for thread in self._callbacks if thread.is_alive()] + new
        return declared

    def _count_neighbours(self, session: zenoh.Session) -> None:
        self._neighbours = len(session.info.peers_zid()) + len(session.info.routers_zid())
        self._counting = False

    def _has_work(self) -> bool:
        return bool(self._stop.is_set() or self._requests or self.outbox or self._patience_s() == 0)

    def _patience_s(self) -> float | None:
        """How long until somebody's state must be asked for; None if nobody watches any."""
        return max(0.0, self._states_due - time.monotonic()) if self._state_watchers else None

    def _send(self, session: zenoh.Session, item: OutgoingMessage) -> None:
        try:
            self._publisher(session, item.key).put(item.payload)
        except zenoh.ZError as error:
            log.debug("%s: %s not sent (%s)", self._name, item.key, error)
            self.failed += 1
        else:
            self.published += 1

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
