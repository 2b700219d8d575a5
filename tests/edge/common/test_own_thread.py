"""Threads of one process share one interpreter: how long one keeps the others waiting is ours to say."""

import sys
import threading

import pytest

from edge.common.own_thread import GIVE_WAY_S, OwnThread, give_way_soon


def test_a_program_has_its_threads_give_way_sooner_than_python_does() -> None:
    before = sys.getswitchinterval()
    try:
        give_way_soon()
        assert sys.getswitchinterval() == pytest.approx(GIVE_WAY_S)
        assert GIVE_WAY_S < 0.005, "Python's own"
    finally:
        sys.setswitchinterval(before)


class Waiting(OwnThread):
    """Waits until it is told to stop; then, if it `hangs`, for that as well."""

    def __init__(self, hangs: threading.Event | None = None) -> None:
        super().__init__("waiting", 0.1)
        self.hangs = hangs

    def _run(self) -> None:
        self._stop.wait(10)
        if self.hangs is not None:
            self.hangs.wait(10)


def test_it_runs_from_start_to_close_and_can_be_closed_again() -> None:
    waiting = Waiting()
    assert not waiting.ended
    waiting.start()
    assert not waiting.ended
    waiting.close()
    waiting.close()
    assert waiting.ended


def test_what_was_never_started_needs_no_end() -> None:
    waiting = Waiting()
    waiting.close()
    assert waiting.join(0.0)
    assert not waiting.ended


def test_several_are_told_first_and_waited_for_afterwards() -> None:
    several = [Waiting() for _ in range(5)]
    for one in several:
        one.start()
    for one in several:
        one.ask_to_stop()
    assert all(one.join(5.0) for one in several)


def test_one_that_hangs_is_left_and_named(caplog: pytest.LogCaptureFixture) -> None:
    free = threading.Event()
    with Waiting(free) as waiting:
        assert not waiting.join(0.0)
        waiting.close()
        assert "waiting: not done within 0.1 s" in caplog.text
        free.set()
        assert waiting.join(5.0)
