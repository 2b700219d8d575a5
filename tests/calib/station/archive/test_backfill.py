"""The station gets every row it lacks from a real spool over a real session, once, and never as live data."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.station.archive.backfill import BACKFILL_REST, LONGEST_REST_S, SHORTEST_REST_S, Backfill, rest_after
from calib.station.archive.ledger import Gap
from edge.link.inbox import Inbox, Received
from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.link.spool import Spool, SpoolSettings
from edge.messages import Backlog, Inventory, SpooledEpoch, Tracks, camera_key, decode, encode

SITE = "field"
KEY = camera_key(SITE, "cam0", "backlog")


def tracks(seq: int, epoch: int = 1) -> Tracks:
    return Tracks(
        t_unix_ns=1_700_000_000_000_000_000 + seq,
        seq=seq,
        epoch=epoch,
        clock_bound_s=None,
        size_px=(1280, 720),
        readout_s=0.0,
        detections=[],
    )


@pytest.fixture
def rooms(endpoint: str, tmp_path: Path) -> Iterator[tuple[Link, Spool]]:
    """The station's link, and a box's spool at its other end."""
    with ExitStack() as stack:
        base = stack.enter_context(Link(LinkSettings(listen=(endpoint,)), name="base"))
        box = stack.enter_context(Link(LinkSettings(connect=(endpoint,)), name="box"))
        settings = SpoolSettings(file=str(tmp_path / "spool.sqlite"), max_mb=100)
        yield base, stack.enter_context(Spool(settings, box.serve(KEY)))


def keep(spool: Spool, seqs: range, epoch: int = 1) -> None:
    for seq in seqs:
        spool.keep(epoch, seq, tracks(seq).t_unix_ns, encode(tracks(seq, epoch)))


def late_seqs(inbox: Inbox[Received]) -> list[tuple[int, int]]:
    rows = [decode(item.payload, Tracks, where=item.key) for item in inbox.drain()]
    return [(row.epoch, row.seq) for row in rows]


def test_gets_what_it_lacks_and_no_more(rooms: tuple[Link, Spool], until: Callable[..., bool], tmp_path: Path) -> None:
    base, spool = rooms
    memory = tmp_path / "memory.json"
    keep(spool, range(20), epoch=1)
    keep(spool, range(600), epoch=2)
    heard = [*range(100), *range(350, 600)]
    lacking = [(2, seq) for seq in range(100, 350)] + [(1, seq) for seq in range(20)]
    with Backfill(base, SITE, memory) as backfill:
        for seq in heard:
            backfill.have("cam0", tracks(seq, epoch=2))
        assert until(lambda: backfill.counters.recovered == 270, within_s=15)
        assert late_seqs(backfill.late) == lacking, "newest run first, each row once"
        backfill._save()
        backfill._save()  # a save is of the state at the save before
    with Backfill(base, SITE, memory) as backfill:
        assert backfill._ledger.gaps("cam0", []) == []
        keep(spool, range(600, 640), epoch=2)
        assert until(lambda: backfill.counters.recovered == 40, within_s=15)
        assert late_seqs(backfill.late) == [(2, seq) for seq in range(600, 640)]


def answer(first: int, last: int, *seqs: int, epoch: int = 1) -> bytes:
    raws = [msgspec.Raw(encode(tracks(seq, epoch))) for seq in seqs]
    return encode(Backlog(epoch=epoch, first_seq=first, last_seq=last, tracks=raws))


@pytest.mark.parametrize(
    "payload",
    [
        b"garbage",
        b"[" * 100_000,
        answer(0, 9, 3, epoch=5),  # another run than was asked for
        answer(5, 9, 3),  # a row outside what the answer says it covers
        answer(20, 30, 25),  # nothing that was asked for
        answer(0, 9, 3).replace(b'"seq":3', b'"seq":-3'),
    ],
)
def test_refuses_answers_to_other_questions(payload: bytes) -> None:
    backfill = Backfill(Link(LinkSettings()), SITE)
    backfill._missing["cam0"] = [Gap(1, 0, 9)]
    backfill._accept("cam0", Gap(1, 0, 9), Received(KEY, payload, 0))
    assert (backfill.counters.refused, backfill.counters.missing, len(backfill.late)) == (1, 10, 0)


def test_what_is_gone_is_counted_and_not_asked_again() -> None:
    backfill = Backfill(Link(LinkSettings()), SITE)
    backfill._missing["cam0"] = [Gap(1, 0, 9)]
    backfill._accept("cam0", Gap(1, 0, 9), Received(KEY, answer(0, 7, 2, 5), 0))
    assert backfill.counters.gone == 6
    assert backfill.counters.missing == 2
    assert backfill._missing["cam0"] == [Gap(1, 8, 9)]


def test_what_still_waits_to_be_recorded_is_not_remembered(tmp_path: Path) -> None:
    """A station too busy to write is killed: what it had fetched and not written must be asked for again."""
    memory = tmp_path / "memory.json"
    backfill = Backfill(Link(LinkSettings()), SITE, memory)
    backfill._missing["cam0"] = [Gap(1, 0, 9)]
    backfill._accept("cam0", Gap(1, 0, 9), Received(KEY, answer(0, 9, *range(10)), 0))
    for left in (10, 1):
        backfill.late.drain(10 - left)
        backfill._save()
        backfill._save()  # a save is of the state at the save before
        assert lacking_after_restart(memory) == [Gap(1, 0, 9)]
    backfill.late.drain()
    backfill._save()
    assert lacking_after_restart(memory) == [Gap(1, 0, 9)], "written this instant, not yet on the disk"
    backfill._save()
    assert lacking_after_restart(memory) == []


def test_what_was_recorded_is_remembered_though_more_waits(tmp_path: Path) -> None:
    memory = tmp_path / "memory.json"
    backfill = Backfill(Link(LinkSettings()), SITE, memory)
    for first in range(0, 40, 4):  # never without a row that waits
        backfill._missing["cam0"] = [Gap(1, first, first + 3)]
        backfill._accept(
            "cam0", Gap(1, first, first + 3), Received(KEY, answer(first, first + 3, *range(first, first + 4)), 0)
        )
        backfill.late.drain(len(backfill.late) - 1)
        backfill._save()
    assert lacking_after_restart(memory) == []


def lacking_after_restart(memory: Path) -> list[Gap]:
    ledger = Backfill(Link(LinkSettings()), SITE, memory)._ledger
    inventory = [SpooledEpoch(epoch=1, first_seq=0, last_seq=9, rows=10)]
    ledger.gaps("cam0", inventory)
    return ledger.gaps("cam0", inventory)


def test_nothing_is_fetched_while_nothing_is_recorded(rooms: tuple[Link, Spool], until: Callable[..., bool]) -> None:
    base, spool = rooms
    keep(spool, range(20))
    backfill = Backfill(base, SITE)
    backfill.paused = True
    with backfill:
        assert not until(lambda: backfill.counters.recovered, within_s=3)
        backfill.paused = False
        assert until(lambda: backfill.counters.recovered == 20, within_s=15)


def test_a_slow_way_is_left_to_what_is_live_most_of_the_time(endpoint: str, until: Callable[..., bool]) -> None:
    """A box that takes 0.1 s for each answer is asked a fifth of the time, however much is lacking."""
    busy_s: list[float] = []
    with ExitStack() as stack:
        base = stack.enter_context(Link(LinkSettings(listen=(endpoint,)), name="base"))
        box = stack.enter_context(Link(LinkSettings(connect=(endpoint,)), name="box"))
        questions, over = box.serve(KEY), threading.Event()

        def answer_slowly() -> None:
            while not over.is_set():
                if (request := questions.get(0.1)) is None:
                    continue
                if not request.parameters:
                    kept = SpooledEpoch(epoch=1, first_seq=0, last_seq=100_000, rows=100_001)
                    request.answer([encode(Inventory(epochs=[kept]))])
                    continue
                first, last = int(request.parameters["first"]), int(request.parameters["last"])
                time.sleep(0.1)
                busy_s.append(0.1)
                rows = [msgspec.Raw(encode(tracks(seq))) for seq in range(first, last + 1)]
                request.answer([encode(Backlog(epoch=1, first_seq=first, last_seq=last, tracks=rows))])

        slow = threading.Thread(target=answer_slowly)
        slow.start()
        backfill = stack.enter_context(Backfill(base, SITE))
        assert until(lambda: busy_s, within_s=15)
        began = time.monotonic()
        asked = len(busy_s)
        time.sleep(5.0)
        share = sum(busy_s[asked:]) / (time.monotonic() - began)
        over.set()
        slow.join()
    assert 0.02 < share < 1 / (1 + BACKFILL_REST) + 0.05
    assert backfill.counters.recovered > 0


@given(took_s=st.floats(0, 100))
def test_a_rest_is_long_enough_and_ends(took_s: float) -> None:
    rest_s = rest_after(took_s)
    assert SHORTEST_REST_S <= rest_s <= LONGEST_REST_S
    assert rest_s >= min(BACKFILL_REST * took_s, LONGEST_REST_S)
