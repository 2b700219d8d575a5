"""Outputs side by side: what one raises or sleeps through is its own affair, and is named."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from calib.station.core.calibration import Phase
from calib.station.core.outgoing import OutgoingTarget, TargetExport
from calib.station.core.station import UNASKED_HZ
from calib.station.fence import SPOKEN_OF_NS
from calib.station.outputs.guarded import GuardedOutput
from calib.station.outputs.output import StationStanding
from calib.station.outputs.outputs import Outputs
from calib.station.outputs.threaded import CALLS_WAITING, STALLED_S, ThreadedOutput
from tests.calib.station.outputs.misbehaving import Misbehaving
from tests.conftest import Until

ORIGIN = (47.4085, 8.5071, 580.0)
STANDING = StationStanding(0, 0, Phase.COLLECTING, "", "", "", (), None, 0, 0)


@contextmanager
def threaded(inner: Misbehaving) -> Iterator[ThreadedOutput]:
    with ThreadedOutput("own", lambda _record: inner, lambda _endpoint, _frame: None) as output:
        yield output
        inner.free.set()


def test_what_one_raises_ends_that_call_alone_and_is_named_for_a_minute() -> None:
    wrong, good = Misbehaving("raises"), Misbehaving()
    outputs = Outputs([GuardedOutput("wrong", wrong), GuardedOutput("good", good)])
    outputs.second(STANDING, [], 0)
    outputs.calibrated(True, 0)
    assert good.calls == wrong.calls == ["second", "calibrated"]
    assert outputs.counters["wrong_failed_calls"] == 2
    assert outputs.counters["good_failed_calls"] == 0
    named = {check.name: check for check in outputs.checks(0)}
    assert "KeyError('calibrated')" in named["output wrong"].reason
    assert "output good" not in named
    assert "output wrong" in {check.name for check in outputs.checks(SPOKEN_OF_NS - 1)}
    assert "output wrong" not in {check.name for check in outputs.checks(SPOKEN_OF_NS)}


def test_being_told_to_stop_is_no_fault_of_an_output() -> None:
    class Interrupted(Misbehaving):
        def calibrated(self, done: bool, now_ns: int) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        GuardedOutput("own", Interrupted()).calibrated(True, 0)


def test_the_fastest_rate_counts_and_without_an_output_there_is_one_still() -> None:
    slow = Misbehaving()
    slow.rate_hz = 2.0  # type: ignore[misc]
    assert Outputs([GuardedOutput("slow", slow), GuardedOutput("fast", Misbehaving())]).rate_hz == 50.0
    assert Outputs([]).rate_hz == UNASKED_HZ


def test_an_output_that_hangs_is_named_and_loses_the_oldest(until: Until) -> None:
    inner = Misbehaving("hangs")
    with threaded(inner) as output:
        output.second(STANDING, [], 0)
        assert until(lambda: inner.calls == ["second"])
        for _ in range(CALLS_WAITING + 10):
            output.second(STANDING, [], 0)
        assert output.counters["own_dropped_calls"] == 10
        assert until(lambda: output.checks(0), within_s=STALLED_S + 5)
        (check,) = output.checks(0)
        assert (check.name, check.level) == ("output own", "warn")
        inner.free.set()
        assert until(lambda: inner.calls.count("second") > CALLS_WAITING // 2)
        assert until(lambda: [check.name for check in output.checks(0)] == ["misbehaving"])
    assert inner.calls[-1] == "close"


def test_the_origin_is_known_before_the_next_targets_however_much_was_dropped(until: Until) -> None:
    inner = Misbehaving("hangs")
    with threaded(inner) as output:
        output.second(STANDING, [], 0)
        assert until(lambda: inner.calls)
        output.moved((1.0, 2.0, 3.0))
        output.moved(ORIGIN)
        for _ in range(2 * CALLS_WAITING):
            output.second(STANDING, [], 0)
        inner.free.set()
        assert until(lambda: inner.origins == [ORIGIN])  # the newest alone: the one before was never sent from


def test_a_command_is_answered_by_the_loop(until: Until) -> None:
    inner = Misbehaving()
    inner.commands = ["calibrate"]
    asked_in: list[str] = []

    def command(wanted: str) -> bool:
        asked_in.append(threading.current_thread().name)
        return wanted == "calibrate"

    with threaded(inner) as output:

        def answered() -> bool:
            output.receive(0, 0, command)
            return inner.answers == [True]

        assert until(answered)
        assert asked_in == [threading.current_thread().name]


def test_what_a_thread_sends_is_recorded_by_the_loop(until: Until) -> None:
    recorded: list[tuple[str, bytes, str]] = []

    def open_one(record) -> Misbehaving:  # type: ignore[no-untyped-def]
        class Sending(Misbehaving):
            def targets(self, targets, now_ns: int, synced: bool) -> None:  # type: ignore[no-untyped-def]
                for _ in targets:
                    record("udp:here", b"\x01")

        return Sending()

    def record(endpoint: str, frame: bytes) -> None:
        recorded.append((endpoint, frame, threading.current_thread().name))

    targets: list[OutgoingTarget] = TargetExport(["cam0"], 2, 50.0).to_wgs84([], ORIGIN)
    with ThreadedOutput("own", open_one, record) as output:
        output.targets([*targets, None], 0, True)  # type: ignore[list-item]

        def came() -> bool:
            output.receive(0, 0, lambda _: False)
            return recorded == [("udp:here", b"\x01", threading.current_thread().name)]

        assert until(came)
