"""A spool on a real disk: it keeps what it was given through kill -9, a full disk and a garbled file."""

import contextlib
import itertools
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.link.inbox import Inbox
from edge.link.request import Request
from edge.link.spool import ANSWER_BYTES, Spool, SpoolSettings, answers
from edge.link.store import SpoolStore, StoredRow
from edge.messages import Backlog, Inventory, decode

Until = Callable[..., bool]


class Question:
    """A request as the link hands it over; what is answered is kept."""

    def __init__(self, **parameters: object) -> None:
        self.parameters = {name: str(value) for name, value in parameters.items()}
        self.answers: list[bytes] | None = None

    def answer(self, payloads: Iterator[bytes]) -> None:
        self.answers = list(payloads)


def ask(requests: Inbox[Request], **parameters: object) -> list[bytes]:
    question = Question(**parameters)
    requests.put(question)  # type: ignore[arg-type]
    deadline = time.monotonic() + 5
    while question.answers is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert question.answers is not None
    return question.answers


def row(seq: int, epoch: int = 1, size: int = 100) -> StoredRow:
    return StoredRow(epoch, seq, 1_700_000_000_000_000_000 + seq, f'{{"n":{seq},"pad":"{"x" * size}"}}'.encode())


def seqs(payloads: list[bytes]) -> list[int]:
    found = [decode(payload, Backlog, where="test") for payload in payloads]
    return [int(bytes(raw).split(b":")[1].split(b",")[0]) for backlog in found for raw in backlog.tracks]


@pytest.fixture
def settings(tmp_path: Path) -> SpoolSettings:
    return SpoolSettings(file=str(tmp_path / "spool.sqlite"), max_mb=1)


def test_answers_at_once_and_after_a_restart(settings: SpoolSettings, until: Until) -> None:
    requests: Inbox[Request] = Inbox(8)
    with Spool(settings, requests) as spool:
        for seq in range(50):
            spool.keep(*row(seq))
        assert seqs(ask(requests, epoch=1, first=10, last=19)) == list(range(10, 20))
    with Spool(settings, requests) as spool:
        assert until(lambda: decode(ask(requests)[0], Inventory, where="test").epochs)
        (kept,) = decode(ask(requests)[0], Inventory, where="test").epochs
        assert (kept.epoch, kept.first_seq, kept.last_seq, kept.rows) == (1, 0, 49, 50)
        assert seqs(ask(requests, epoch=1, first=0, last=99)) == list(range(50))
        assert spool.counters.served == 50


@given(st.lists(st.integers(0, 40), unique=True).map(sorted), st.integers(0, 20), st.integers(0, 20_000))
def test_answers_cover_what_was_asked_exactly_once(kept: list[int], first: int, size: int) -> None:
    last = first + 30
    rows = [row(seq, size=size) for seq in kept if first <= seq <= last]
    payloads = list(answers(rows, 1, first, last))
    found = [decode(payload, Backlog, where="test") for payload in payloads]
    assert found[0].first_seq == first
    assert found[-1].last_seq == last
    assert all(before.last_seq + 1 == after.first_seq for before, after in itertools.pairwise(found))
    assert seqs(payloads) == [item.seq for item in rows]
    largest = max((len(item.payload) for item in rows), default=0)
    assert all(len(payload) <= max(ANSWER_BYTES, largest) + 400 for payload in payloads)


@given(
    st.dictionaries(st.sampled_from(["epoch", "first", "last", "x"]), st.one_of(st.text(max_size=30), st.integers()))
)
def test_no_question_ends_the_spool(parameters: dict[str, object]) -> None:
    spool = Spool(SpoolSettings(file="/nonexistent", max_mb=1), Inbox(8))
    question = Question(**parameters)
    spool._answer(question)  # type: ignore[arg-type]
    assert question.answers is not None or spool.counters.bad_requests == 1


def test_oldest_go_when_it_is_full(tmp_path: Path) -> None:
    store = SpoolStore(tmp_path / "spool.sqlite", max_bytes=100_000)
    evicted = sum(store.add([row(seq, size=1000) for seq in range(start, start + 50)]) for start in range(0, 2000, 50))
    (kept,) = store.inventory()
    assert kept.last_seq == 1999
    assert kept.rows == 2000 - evicted <= 100
    store.close()
    assert (tmp_path / "spool.sqlite").stat().st_size < 300_000


def test_a_garbled_file_is_set_aside(settings: SpoolSettings, until: Until) -> None:
    Path(settings.file).write_bytes(b"not a database at all" * 500)
    requests: Inbox[Request] = Inbox(8)
    with Spool(settings, requests) as spool:
        spool.keep(*row(1))
        assert until(lambda: spool.counters.committed == 1)
        assert not spool.error
    assert Path(settings.file + ".garbled").exists()


def test_cut_off_anywhere_by_a_power_cut_it_goes_on(tmp_path: Path) -> None:
    """Of the file and of its journal only a part has reached the disk: what can be read is kept, the rest set aside."""
    whole = tmp_path / "whole"
    whole.mkdir()
    store = SpoolStore(whole / "spool.sqlite", max_bytes=1_000_000)
    store.add([row(seq, size=500) for seq in range(100)])
    files = {file.name: file.read_bytes() for file in whole.iterdir()}  # before it is closed, as a power cut leaves it
    store.close()
    cuts = [(name, cut) for name, data in files.items() for cut in range(0, len(data), max(1, len(data) // 12) | 1)]
    for name, cut in cuts:
        folder = tmp_path / f"{name}-{cut}"
        folder.mkdir()
        for other, data in files.items():
            (folder / other).write_bytes(data[:cut] if other == name else data)
        with Spool(SpoolSettings(file=str(folder / "spool.sqlite"), max_mb=1), Inbox(8)) as spool:
            spool.keep(*row(1000, epoch=2))
        assert spool.counters.committed == 1, (name, cut)
        assert not spool.error, (name, cut)


def test_a_disk_that_refuses_costs_nothing_but_memory(tmp_path: Path, until: Until) -> None:
    blocked = tmp_path / "file_not_folder"
    blocked.write_text("")
    requests: Inbox[Request] = Inbox(8)
    with Spool(SpoolSettings(file=str(blocked / "spool.sqlite"), max_mb=1), requests) as spool:
        for seq in range(20):
            spool.keep(*row(seq))
        assert until(lambda: spool.error)
        assert seqs(ask(requests, epoch=1, first=0, last=19)) == list(range(20))
        assert spool.counters.disk_failures >= 1


def test_a_full_disk_is_named_and_got_over(tmp_path: Path) -> None:
    store = SpoolStore(tmp_path / "spool.sqlite", max_bytes=10_000_000)
    store._file.execute("PRAGMA max_page_count = 20")  # SQLite then says "database or disk is full", as on ENOSPC
    with pytest.raises(sqlite3.OperationalError, match="full"):
        store.add([row(seq, size=1000) for seq in range(500)])
    assert store.inventory() == []
    store._file.execute("PRAGMA max_page_count = 100000")
    store.add([row(seq, size=1000) for seq in range(500)])
    assert store.inventory()[0].rows == 500
    store.close()


WRITER = """
import sys, time
from edge.link.inbox import Inbox
from edge.link.request import Request
from edge.link.spool import Spool, SpoolSettings
with Spool(SpoolSettings(file=sys.argv[1], max_mb=1), Inbox(8)) as spool:
    for seq in range(100000):
        spool.keep(1, seq, 1700000000000000000, b'{"n":%d,' % seq + b'"pad":0}')
        if seq % 10 == 0:
            print(seq, spool.counters.committed, flush=True)
        time.sleep(0.001)
"""


def test_kill_loses_at_most_what_was_not_committed(tmp_path: Path) -> None:
    file = tmp_path / "spool.sqlite"
    with subprocess.Popen([sys.executable, "-c", WRITER, str(file)], stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        time.sleep(2.0)
        os.kill(writer.pid, signal.SIGKILL)
        said = [line.split() for line in writer.stdout.read().splitlines()]
    committed = int(said[-1][1])
    assert committed > 0
    store = SpoolStore(file, max_bytes=10_000_000)
    rows = store.rows(1, 0, 100_000)
    store.close()
    assert [item.seq for item in rows] == list(range(len(rows))), "a hole, or a row that is not whole"
    assert len(rows) >= committed


# As ours but for what each adds.
_KNOWN = "id INTEGER PRIMARY KEY, epoch INTEGER NOT NULL, t_unix_ns INTEGER NOT NULL, payload BLOB NOT NULL"
OTHER_TABLES = {
    "a column that must be given": f"CREATE TABLE rows ({_KNOWN}, seq INTEGER, camera TEXT NOT NULL)",
    "a column that is called otherwise": f"CREATE TABLE rows ({_KNOWN}, number INTEGER)",
}


@pytest.mark.parametrize("table", OTHER_TABLES.values(), ids=OTHER_TABLES)
def test_a_table_of_another_version_is_set_aside(tmp_path: Path, table: str) -> None:
    file = tmp_path / "spool.sqlite"
    with contextlib.closing(sqlite3.connect(file)) as other:
        other.execute(table)
    with contextlib.closing(SpoolStore(file, max_bytes=10**6)) as store:
        store.add([StoredRow(1, 1, 10**18, b"x")])
        assert [kept.rows for kept in store.inventory()] == [1]
    assert Path(f"{file}.garbled").exists()


def test_a_table_with_a_further_column_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "spool.sqlite"
    with contextlib.closing(SpoolStore(file, max_bytes=10**6)) as store:
        store.add([StoredRow(1, 1, 10**18, b"x")])
    with contextlib.closing(sqlite3.connect(file)) as later:
        later.execute("ALTER TABLE rows ADD COLUMN camera TEXT")
        later.execute("PRAGMA user_version = 99")
        later.commit()
    with contextlib.closing(SpoolStore(file, max_bytes=10**6)) as store:
        store.add([StoredRow(1, 2, 10**18, b"y")])
        assert [kept.rows for kept in store.inventory()] == [2]
