"""What waits to be sent is bounded, and never stale."""

import threading
import time

import pytest

from edge.link.outbox import OUTBOX_MESSAGES, STALE_NS, Outbox


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A clock that moves when it is told to."""
    at = [10**12]
    monkeypatch.setattr(time, "monotonic_ns", lambda: at[0])
    return at


def taken(outbox: Outbox, changed: threading.Condition) -> list[bytes]:
    with changed:
        return [item.payload for item in outbox.take()]


def test_in_order_and_once(now: list[int]) -> None:
    changed = threading.Condition()
    outbox = Outbox(changed)
    outbox.put("a", b"1")
    outbox.put("b", b"2")
    assert taken(outbox, changed) == [b"1", b"2"]
    assert taken(outbox, changed) == []
    assert (outbox.dropped, outbox.stale) == (0, 0)


def test_the_oldest_goes_when_there_is_no_room(now: list[int]) -> None:
    changed = threading.Condition()
    outbox = Outbox(changed)
    for k in range(OUTBOX_MESSAGES + 3):
        outbox.put("a", str(k).encode())
    assert len(outbox) == OUTBOX_MESSAGES
    assert outbox.dropped == 3
    assert taken(outbox, changed)[0] == b"3"


def test_what_is_stale_is_thrown_away_and_counted(now: list[int]) -> None:
    changed = threading.Condition()
    outbox = Outbox(changed)
    outbox.put("a", b"old")
    now[0] += STALE_NS + 1
    outbox.put("a", b"new")
    assert taken(outbox, changed) == [b"new"]
    assert outbox.stale == 1
