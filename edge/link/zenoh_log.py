"""What Zenoh says only in its log: whom it turned away, and why. Counted, so that health can tell.

A box with an expired certificate sees nothing but a timeout, and an intruder is seen nowhere: refused handshakes and
refused messages show only as lines that the library writes to standard output. So those lines are led through a pipe,
counted by kind, and the reasons passed on to our own log, each once a minute. The pipe never blocks its writer: under a
flood lines are lost, and the count is then too low, but the live stream goes on. Processes that are started meanwhile
inherit the pipe and keep it open (the solver's, and Python's own that looks after it): its end is never waited for.
"""

import fcntl
import io
import logging
import os
import re
import select
import sys
import threading
import time
from typing import Final, Self

import msgspec
import zenoh

from edge.common.own_thread import OwnThread

log = logging.getLogger(__name__)

# One line for each refused message, without the hundreds of lines about those that were allowed.
_FILTER: Final = "warn,zenoh::net::routing::interceptor=trace,zenoh::net::routing::interceptor::access_control=off"
_REFUSED_MESSAGE: Final = b"Msg intercepted!"
_HANDSHAKE: Final = re.compile(rb"zenoh_link_(?:tls|quic)[\w:]*: (.*?)(?:\. Hint: .*)?$", re.MULTILINE)
_NUMBERS: Final = re.compile(r"\d+")  # differ from line to line; the reason does not
_HARMLESS: Final = (b"Gossip is disabled", b"Scouting delay elapsed", b"Unknown token", b"unknown Request")
_STYLE: Final = re.compile(rb"\x1b\[[0-9;]*m")
LOG_CLOSE_S: Final = 1.0  # the thread reads what is in the pipe, and no more
PIPE_BYTES: Final = 1 << 20  # what waits while our thread does not get its turn
PIECE_BYTES: Final = 1 << 16  # read at a time
REPEAT_S: Final = 60.0
MAX_REASONS: Final = 100  # remembered; an intruder cannot fill the memory with inventive ones


class Refusals(msgspec.Struct, frozen=True, kw_only=True):
    """How often somebody was turned away since the start; every number only grows."""

    handshakes: int = 0  # no certificate, a wrong authority, expired, not TLS at all
    messages: int = 0  # a certificate that may not say this
    last_reason: str = ""


class LogReader:
    """Counts refusals in the log's bytes. Pure: bytes and time are handed in."""

    def __init__(self) -> None:
        self.refusals = Refusals()
        self._rest = b""
        self._reported_s: dict[str, float] = {}

    def read(self, chunk: bytes, now_s: float) -> list[str]:
        """Take in a chunk; returns the sentences worth passing on, each at most once a minute."""
        lines, newline, rest = (self._rest + chunk).rpartition(b"\n")
        self._rest = rest[-PIPE_BYTES:]
        if not newline:
            return []
        text = _STYLE.sub(b"", lines)
        reasons = [reason.decode(errors="replace") for reason in _HANDSHAKE.findall(text)]
        self.refusals = Refusals(
            handshakes=self.refusals.handshakes + len(reasons),
            messages=self.refusals.messages + text.count(_REFUSED_MESSAGE),
            last_reason=reasons[-1] if reasons else self.refusals.last_reason,
        )
        others = [line.decode(errors="replace") for line in text.split(b"\n") if _is_news(line)]
        return [sentence for sentence in dict.fromkeys(reasons + others) if self._is_due(sentence, now_s)]

    def _is_due(self, sentence: str, now_s: float) -> bool:
        kind = _NUMBERS.sub("#", sentence)
        if now_s - self._reported_s.get(kind, -REPEAT_S) < REPEAT_S:
            return False
        if len(self._reported_s) >= MAX_REASONS:
            self._reported_s.clear()
        self._reported_s[kind] = now_s
        return True


def _is_news(line: bytes) -> bool:
    if not line or _REFUSED_MESSAGE in line or _HANDSHAKE.search(line):
        return False
    return not any(harmless in line for harmless in _HARMLESS)


_current: "ZenohLog | None" = None  # the library has one log for the whole process


def refusals() -> Refusals:
    """Who was turned away so far in this process; nobody, as far as can be told, while no ZenohLog is entered."""
    return Refusals() if _current is None else _current.refusals


class ZenohLog(OwnThread):
    """Leads the library's log through a pipe for as long as it is entered. At most once in a process, and early."""

    def __init__(self) -> None:
        super().__init__("zenoh-log", LOG_CLOSE_S)
        self._reader = LogReader()
        self._lock = threading.Lock()
        self._source = -1  # the pipe's reading end
        self._roused, self._rouse = -1, -1  # a pipe that has its end when the thread is to stop

    def __enter__(self) -> Self:
        global _current  # noqa: PLW0603 -- as global as standard output is
        _current = self
        self._source, sink = os.pipe()
        self._roused, self._rouse = os.pipe()
        fcntl.fcntl(sink, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        for end in (sink, self._source):
            os.set_blocking(end, False)
        sys.stdout.flush()
        self._real_stdout = os.dup(1)
        self._python_stdout = sys.stdout
        sys.stdout = os.fdopen(os.dup(1), "w", buffering=1)  # ours still goes where it always went
        os.dup2(sink, 1)
        os.close(sink)
        zenoh.init_log_from_env_or(_FILTER)
        return super().__enter__()

    def _wake(self) -> None:
        os.dup2(self._real_stdout, 1)  # from here on nothing of ours goes into the pipe
        os.close(self._real_stdout)
        os.close(self._rouse)
        sys.stdout.close()
        sys.stdout = self._python_stdout

    @property
    def refusals(self) -> Refusals:
        """Who was turned away so far."""
        with self._lock:
            return self._reader.refusals

    def _run(self) -> None:
        with os.fdopen(self._source, "rb", buffering=0) as pipe, os.fdopen(self._roused, "rb", buffering=0) as roused:
            ending = False
            while not ending:
                ready, _, _ = select.select([pipe, roused], [], [])
                ending = roused in ready
                self._take_all(pipe)

    def _take_all(self, pipe: io.RawIOBase) -> None:
        """Read what is in the pipe now."""
        while chunk := pipe.read(PIECE_BYTES):
            with self._lock:
                sentences = self._reader.read(chunk, time.monotonic())
            for sentence in sentences:
                log.warning("zenoh: %s", sentence)
