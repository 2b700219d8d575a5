"""An inbox forgets its oldest item, counts it, and never makes the sender wait."""

import threading

from edge.link.inbox import Inbox


def test_oldest_goes_first_and_is_counted() -> None:
    inbox: Inbox[int] = Inbox(3)
    for number in range(5):
        inbox.put(number)
    assert inbox.drain() == [2, 3, 4]
    assert (inbox.received, inbox.dropped) == (5, 2)


def test_get_waits_for_another_thread_and_rings_the_bell() -> None:
    bell = threading.Event()
    inbox: Inbox[str] = Inbox(1, bell)
    timer = threading.Timer(0.05, inbox.put, ("hello",))
    timer.start()
    assert inbox.get(5.0) == "hello"
    assert bell.is_set()
    timer.join()


def test_get_gives_up_after_its_timeout() -> None:
    assert Inbox[int](1).get(0.01) is None
