"""Fetching what the live way lost: the station asks each box for the sequence numbers it lacks, until it has them all.

What comes this way is late: it belongs in the recording and in `solve`, and must never touch live tracking, whose
filters have long moved on. It comes through an inbox of its own, under the `backlog` key. And it must not delay what
is live: the questions are small, at low priority, and after each answer comes a rest of several times as long as the
answer took, so that history gets a share of a busy computer or a slow radio, and never all of it. What is already here
is remembered over a restart, in a file that is four seconds behind on purpose, and further while rows wait to be
recorded: after a power cut the recording may have lost its last seconds, and then the memory of having had them must be
lost too.
"""

import logging
import threading
import time
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from calib.station.archive.ledger import Gap, Ledger
from calib.station.core.ranges import Ranges
from edge.common.atomic import write_atomically
from edge.common.errors import MessageError
from edge.common.own_thread import OwnThread
from edge.link.inbox import Inbox, Received
from edge.link.link import Link
from edge.messages import Backlog, Inventory, Tracks, camera_key, camera_of_key, decode

log = logging.getLogger(__name__)

INVENTORY_S: Final = 2.0  # between inventories; a lost message is in the recording about two of them later
BACKFILL_REST: Final = 4.0  # times as long as an answer took: history gets a fifth of what the slowest link can do
SHORTEST_REST_S: Final = 0.03  # between questions; with ROWS_PER_QUESTION at most 600 rows a second, 20 cameras' worth
LONGEST_REST_S: Final = 2.0  # after a question that nobody answered
ROWS_PER_QUESTION: Final = 20  # about 10 kB: what is live never waits for more of one answer than that
LATE_CAPACITY: Final = 20_000  # rows; asking stops while the station has half of that to write
SAVE_EVERY_POLLS: Final = 2  # and a save is of the state at the save before: the recording is on the disk within 2 s
BACKFILL_CLOSE_S: Final = 2.5


class BackfillCounters(msgspec.Struct, frozen=True, kw_only=True):
    """What backfilling did so far; `missing` goes down again, the others only grow."""

    missing: int  # known to be on the boxes and not yet here
    recovered: int
    gone: int  # numbers whose rows no box has any more
    refused: int  # answers that were not what was asked


class _State(NamedTuple):
    """The ledger at some time, as it is saved: how many rows had come late by then, and whether they are recorded."""

    ledger: bytes
    received: int
    recorded: bool


class Backfill(OwnThread):
    """Asks the boxes of a site for what is missing. `late` holds what came, under `.../cam/<camera>/backlog` keys."""

    def __init__(self, link: Link, site: str, memory: Path | None = None) -> None:
        """memory: a file that remembers over restarts what the station has; None: ask anew for everything."""
        super().__init__("backfill", BACKFILL_CLOSE_S)
        self._link = link
        self._site = site
        self._memory = memory
        self.paused = False  # set while nothing is recorded: what is fetched then would be lost for good
        self.late: Inbox[Received] = Inbox(LATE_CAPACITY, link.bell)
        self._lock = threading.Lock()
        self._ledger = _load(memory) if memory is not None else Ledger()
        self._missing: dict[str, list[Gap]] = {}
        self._reachable: set[str] = set()  # cameras that answered the last question for inventories
        self._pending = self._state()
        self._counts = dict.fromkeys(BackfillCounters.__struct_fields__, 0)

    def have(self, camera: str, tracks: Tracks) -> None:
        """Note a live message that was recorded."""
        self.have_number(camera, tracks.epoch, tracks.seq)

    def have_number(self, camera: str, epoch: int, seq: int) -> None:
        """As `have`, for a message that is already decoded elsewhere."""
        with self._lock:
            self._ledger.have(camera, epoch, seq, seq)

    @property
    def counters(self) -> BackfillCounters:
        """What backfilling did so far."""
        with self._lock:
            missing = sum(len(gap) for gaps in self._missing.values() for gap in gaps)
            return BackfillCounters(**(self._counts | {"missing": missing}))

    # The thread

    def _run(self) -> None:
        polls = 0
        while not self._stop.wait(SHORTEST_REST_S):
            if self.paused:
                continue
            self._take_stock()
            polls += 1
            if polls % SAVE_EVERY_POLLS == 0:
                self._save()
            self._fetch_for(INVENTORY_S)

    def _take_stock(self) -> None:
        self._reachable.clear()
        for answer in self._link.ask(camera_key(self._site, "*", "backlog"), give_up=self._stop):
            camera = camera_of_key(answer.key)
            try:
                inventory = decode(answer.payload, Inventory, where=answer.key)
            except MessageError as error:
                self._refuse(str(error))
                continue
            if camera is not None:
                self._reachable.add(camera)
                with self._lock:
                    self._missing[camera] = self._ledger.gaps(camera, inventory.epochs)

    def _fetch_for(self, seconds: float) -> None:
        """Ask the cameras that lack something in turn for their next stretches, for about so long."""
        ends_s = time.monotonic() + seconds
        while lacking := [camera for camera in sorted(self._reachable) if self._missing[camera]]:
            for camera in lacking:
                began_s = time.monotonic()
                if self._has_room():
                    self._fetch(camera, self._missing[camera][0])
                if self._stop.wait(rest_after(time.monotonic() - began_s)) or time.monotonic() >= ends_s:
                    return
        self._stop.wait(max(0.0, ends_s - time.monotonic()))

    def _has_room(self) -> bool:
        return len(self.late) < LATE_CAPACITY // 2 and not self.paused and not self._stop.is_set()

    def _fetch(self, camera: str, gap: Gap) -> None:
        wanted = Gap(gap.epoch, gap.first_seq, min(gap.last_seq, gap.first_seq + ROWS_PER_QUESTION - 1))
        key = camera_key(self._site, camera, "backlog")
        question = f"{key}?epoch={wanted.epoch};first={wanted.first_seq};last={wanted.last_seq}"
        for answer in self._link.ask(question, give_up=self._stop):
            if answer.key == key:
                self._accept(camera, wanted, answer)

    def _accept(self, camera: str, wanted: Gap, answer: Received) -> None:
        try:
            backlog = decode(answer.payload, Backlog, where=answer.key)
            rows = [(raw, decode(bytes(raw), Tracks, where=answer.key)) for raw in backlog.tracks]
        except MessageError as error:
            self._refuse(str(error))
            return
        covered = range(max(backlog.first_seq, wanted.first_seq), min(backlog.last_seq, wanted.last_seq) + 1)
        if any(tracks.epoch != wanted.epoch or tracks.seq not in covered for _, tracks in rows) or not covered:
            self._refuse(f"{answer.key}: rows that were not asked for")
            return
        for raw, _ in rows:
            self.late.put(Received(answer.key, bytes(raw), answer.t_monotonic_ns))
        self._settle(camera, wanted.epoch, covered, len(rows))

    def _settle(self, camera: str, epoch: int, covered: range, rows: int) -> None:
        with self._lock:
            self._ledger.have(camera, epoch, covered[0], covered[-1])
            self._counts["recovered"] += rows
            self._counts["gone"] += len(covered) - rows
            self._missing[camera] = [
                rest
                for gap in self._missing[camera]
                for rest in (_without(gap, covered) if gap.epoch == epoch else [gap])
            ]

    def _refuse(self, why: str) -> None:
        log.debug("backlog answer refused: %s", why)
        with self._lock:
            self._counts["refused"] += 1

    def _save(self) -> None:
        """Write the state of the save before, if what had come by then was recorded by then; if not, a save later.

        A station killed before it wrote what it fetched must not remember to have it.
        """
        if self._memory is None:
            return
        pending = self._pending
        if not pending.recorded:
            recorded = self.late.received - len(self.late) >= pending.received
            self._pending = pending._replace(recorded=recorded)
            return
        self._pending = self._state()
        try:
            write_atomically(self._memory, pending.ledger)
        except OSError as error:
            log.warning(
                "%s: cannot be written (%s); after a restart more is asked for than needed", self._memory, error
            )

    def _state(self) -> _State:
        with self._lock:
            ledger = self._ledger.to_json()
        received, waiting = self.late.received, len(self.late)
        return _State(ledger, received, recorded=waiting == 0)


def rest_after(took_s: float) -> float:
    """How long to leave everything to what is live, after an answer that took so long."""
    return min(max(BACKFILL_REST * took_s, SHORTEST_REST_S), LONGEST_REST_S)


def _without(gap: Gap, covered: range) -> list[Gap]:
    rest = Ranges([(covered[0], covered[-1])]).missing(gap.first_seq, gap.last_seq)
    return [Gap(gap.epoch, first, last) for first, last in rest]


def _load(memory: Path) -> Ledger:
    try:
        return Ledger.from_json(memory.read_bytes())
    except FileNotFoundError:
        return Ledger()
    except (OSError, msgspec.MsgspecError, ValueError) as error:
        log.warning("%s: cannot be read (%s); the boxes are asked for everything they have", memory, error)
        return Ledger()
