"""What systemd sees of the real programs: ready when they are, fed while they work, hungry when they hang."""

import signal
import time
from contextlib import ExitStack
from pathlib import Path

from edge.link.link import Link
from edge.link.settings import LinkSettings
from tests.field import boxes
from tools.doubles.base import TrackingBase
from tools.doubles.supervisor import Supervisor

WATCHDOG_S = 4.0
STARTS_WITHIN_S = 60.0  # on a busy machine


def lives_through(systemd: Supervisor, process: object) -> None:
    """Ready, fed, frozen and hungry, thawed and fed, and off in order."""
    assert systemd.wait_for("READY=1", STARTS_WITHIN_S)
    fed = systemd.listen(WATCHDOG_S).count("WATCHDOG=1")
    assert fed >= WATCHDOG_S / 2, "at least twice within systemd's patience"
    process.send_signal(signal.SIGSTOP)  # type: ignore[attr-defined]
    systemd.listen(0.5)
    assert "WATCHDOG=1" not in systemd.listen(2.0), "fed by something that does not work"
    process.send_signal(signal.SIGCONT)  # type: ignore[attr-defined]
    assert "WATCHDOG=1" in systemd.listen(WATCHDOG_S)
    process.send_signal(signal.SIGTERM)  # type: ignore[attr-defined]
    assert systemd.wait_for("STOPPING=1", 5.0)
    assert process.wait(10) == 0  # type: ignore[attr-defined]


def test_a_base_station_under_systemd(tmp_path: Path) -> None:
    base = TrackingBase(tmp_path, [])
    with ExitStack() as stack:
        systemd = stack.enter_context(Supervisor(tmp_path, WATCHDOG_S))
        stack.callback(base.kill)
        base.start(environment=systemd.environment)
        base.wait_until_up()
        lives_through(systemd, base.process)


def test_a_camera_box_under_systemd(tmp_path: Path, endpoint: str) -> None:
    file = boxes.prepare(tmp_path, endpoint)
    with ExitStack() as stack:
        stack.enter_context(Link(LinkSettings(listen=(endpoint,)), name="base"))
        systemd = stack.enter_context(Supervisor(tmp_path, WATCHDOG_S))
        process = boxes.start(file, environment=systemd.environment)
        stack.callback(process.wait)
        stack.callback(process.kill)
        lives_through(systemd, process)


def test_a_box_without_a_base_is_ready_all_the_same(tmp_path: Path, endpoint: str) -> None:
    file = boxes.prepare(tmp_path, endpoint)
    with Supervisor(tmp_path, WATCHDOG_S) as systemd:
        process = boxes.start(file, environment=systemd.environment)
        try:
            assert systemd.wait_for("READY=1", STARTS_WITHIN_S)
            time.sleep(1.0)
            assert "WATCHDOG=1" in systemd.listen(WATCHDOG_S)
        finally:
            process.kill()
            process.wait()
