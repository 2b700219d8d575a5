"""Store and forward: what a camera measured waits on disk until the base has it, however long the link is down.

Zenoh loses what is in flight when a link dies, and its own recovery was measured to lose whole cuts. So every Tracks
message is kept here before it is sent, and the base asks for the sequence numbers it lacks (the `backlog` key). The
measuring loop must wait for neither disk nor network: `keep` only appends to a bounded queue, and a thread of the
spool's own commits twice a second and answers. A full or read-only disk costs memory, then the oldest rows, but never
a frame.
"""

import logging
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from edge.common.own_thread import OwnThread
from edge.link.inbox import Inbox
from edge.link.request import Request
from edge.link.store import SpoolStore, StoredRow
from edge.messages import MAX_BACKLOG_ROWS, Backlog, Inventory, SpooledEpoch, encode

log = logging.getLogger(__name__)

COMMIT_S: Final = 0.5  # what kill -9 or a power cut may cost
DISK_RETRY_S: Final = 5.0  # between attempts at a disk that refuses
SPOOL_CLOSE_S: Final = 2.0
WAITING_ROWS: Final = 18_000  # kept in memory while the disk refuses: ten minutes at 30 Hz, about 10 MB
BATCH_ROWS: Final = 2_000  # in one commit
ANSWER_BYTES: Final = 8_000  # of one reply: longer ones delay what is live; 64 ms of a radio of 1 Mbit/s


class SpoolSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the observations of one camera are kept, and how much of them: 500 MB is about nine hours at 30 Hz."""

    file: str
    max_mb: int


class SpoolCounters(msgspec.Struct, frozen=True, kw_only=True):
    """What a spool did since it was made; every number only grows."""

    kept: int
    committed: int
    evicted: int  # the oldest, to stay within the size
    dropped: int  # never reached the disk: it refused for too long
    served: int  # rows the base lacked and asked for: what the live way lost
    bad_requests: int
    disk_failures: int


class Spool(OwnThread):
    """The last hours of one camera on disk. Node's side: `keep`. Base's side: the requests of the `backlog` key.

    Closing it commits what waits and closes the file.
    """

    def __init__(self, settings: SpoolSettings, requests: Inbox[Request]) -> None:
        """requests: `link.serve(camera_key(site, camera, "backlog"))`."""
        super().__init__("spool", SPOOL_CLOSE_S)
        self._settings = settings
        self._requests = requests
        self._store: SpoolStore | None = None
        self._lock = threading.Lock()
        self._waiting: deque[StoredRow] = deque()
        self._batch: list[StoredRow] = []  # being committed; only the spool's thread touches it
        self._next_try = 0.0
        self._error = ""
        self._counts = dict.fromkeys(SpoolCounters.__struct_fields__, 0)

    def keep(self, epoch: int, seq: int, t_unix_ns: int, payload: bytes) -> None:
        """Keep one Tracks message, as it is sent; never blocks."""
        with self._lock:
            if len(self._waiting) >= WAITING_ROWS:
                self._waiting.popleft()
                self._counts["dropped"] += 1
            self._waiting.append(StoredRow(epoch, seq, t_unix_ns, payload))
            self._counts["kept"] += 1

    @property
    def error(self) -> str:
        """What the disk refuses to do; empty while it works."""
        return self._error

    @property
    def counters(self) -> SpoolCounters:
        """What this spool did so far."""
        with self._lock:
            return SpoolCounters(**self._counts)

    # The spool's own thread

    def _run(self) -> None:
        next_commit = time.monotonic()
        while not self._stop.is_set():
            request = self._requests.get(max(0.0, next_commit - time.monotonic()))
            if time.monotonic() >= next_commit:
                self._commit()
                next_commit = time.monotonic() + COMMIT_S
            if request is not None:
                self._answer(request)
        self._next_try = 0.0
        self._commit()
        if self._store is not None:
            self._store.close()

    def _commit(self) -> None:
        self._take_batch()
        if time.monotonic() < self._next_try:
            return
        try:
            if self._store is None:
                self._store = SpoolStore(Path(self._settings.file), max_bytes=self._settings.max_mb * 1_000_000)
            while self._batch:
                evicted = self._store.add(self._batch)
                self._count(committed=len(self._batch), evicted=evicted)
                self._batch = []
                self._take_batch()
        except (sqlite3.Error, OSError) as error:
            self._refused(error)
        else:
            self._error = ""

    def _take_batch(self) -> None:
        with self._lock:
            while self._waiting and len(self._batch) < BATCH_ROWS:
                self._batch.append(self._waiting.popleft())

    def _refused(self, error: Exception) -> None:
        self._next_try = time.monotonic() + DISK_RETRY_S
        self._count(disk_failures=1)
        if self._error != str(error):
            log.warning("spool %s: the disk refuses (%s); keeping rows in memory", self._settings.file, error)
        self._error = str(error)

    def _count(self, **more: int) -> None:
        with self._lock:
            for name, n in more.items():
                self._counts[name] += n

    # Answers

    def _answer(self, request: Request) -> None:
        try:
            wanted = _wanted(request.parameters)
            if wanted is None:
                request.answer([encode(Inventory(epochs=self._inventory()))])
            else:
                request.answer(self._backlog(*wanted))
        except ValueError as error:
            log.debug("backlog asked for what it does not understand: %s", error)
            self._count(bad_requests=1)
        except sqlite3.Error as error:
            self._refused(error)  # unanswered: the base asks again

    def _inventory(self) -> list[SpooledEpoch]:
        kept = {item.epoch: item for item in (self._store.inventory() if self._store else [])}
        for row in self._in_memory():
            item = kept.get(row.epoch)
            kept[row.epoch] = SpooledEpoch(
                epoch=row.epoch,
                first_seq=min(row.seq, item.first_seq) if item else row.seq,
                last_seq=max(row.seq, item.last_seq) if item else row.seq,
                rows=item.rows + 1 if item else 1,
            )
        return list(kept.values())

    def _in_memory(self) -> Sequence[StoredRow]:
        with self._lock:
            return [*self._batch, *self._waiting]

    def _backlog(self, epoch: int, first_seq: int, last_seq: int) -> Iterator[bytes]:
        last_seq = min(last_seq, first_seq + MAX_BACKLOG_ROWS - 1)
        rows = {row.seq: row for row in (self._store.rows(epoch, first_seq, last_seq) if self._store else [])}
        rows |= {row.seq: row for row in self._in_memory() if row.epoch == epoch and first_seq <= row.seq <= last_seq}
        self._count(served=len(rows))
        return answers([rows[seq] for seq in sorted(rows)], epoch, first_seq, last_seq)


def answers(rows: Sequence[StoredRow], epoch: int, first_seq: int, last_seq: int) -> Iterator[bytes]:
    """Encoded Backlog messages of about 8 kB that together cover first_seq to last_seq. rows: in order of seq."""
    chunk: list[StoredRow] = []
    begin, size = first_seq, 0
    for row in rows:
        if size + len(row.payload) > ANSWER_BYTES and chunk:
            yield _encode(chunk, epoch, begin, chunk[-1].seq)
            begin, chunk, size = chunk[-1].seq + 1, [], 0
        chunk.append(row)
        size += len(row.payload)
    yield _encode(chunk, epoch, begin, last_seq)


def _encode(rows: Sequence[StoredRow], epoch: int, first_seq: int, last_seq: int) -> bytes:
    tracks = [msgspec.Raw(row.payload) for row in rows]
    return encode(Backlog(epoch=epoch, first_seq=first_seq, last_seq=last_seq, tracks=tracks))


def _wanted(parameters: dict[str, str]) -> tuple[int, int, int] | None:
    """(epoch, first, last) asked for, or None for the inventory. Raises ValueError for anything else."""
    if not parameters:
        return None
    try:
        epoch, first, last = (int(parameters[name]) for name in ("epoch", "first", "last"))
    except KeyError as missing:
        raise ValueError(f"{missing} is missing") from missing
    if not (0 <= epoch <= 2**53 and 0 <= first <= last <= 2**53):
        raise ValueError(f"epoch {epoch}, {first} to {last} is out of range")
    return epoch, first, last
