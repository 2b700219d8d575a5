"""systemd is told over its real socket, and the watchdog goes hungry when anything stands still."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from edge.common.systemd_notify import Heartbeat, Notifier


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[tuple[socket.socket, dict[str, str]]]:
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(path)
        listener.settimeout(1.0)
        yield listener, {"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "20000000", "WATCHDOG_PID": str(os.getpid())}


def test_says_ready_alive_and_stopping(systemd: tuple[socket.socket, dict[str, str]]) -> None:
    listener, environment = systemd
    notifier = Notifier(environment)
    assert notifier.watchdog_s == 20.0
    notifier.ready("three\ncameras")
    assert listener.recv(500) == b"READY=1\nSTATUS=three cameras"
    assert notifier.feed({"cam0": 1}, 0.0) == []
    assert listener.recv(500) == b"WATCHDOG=1"
    assert notifier.feed({"cam0": 1}, 10.1) == ["cam0"]
    notifier.stopping()
    assert listener.recv(500) == b"STOPPING=1", "the watchdog was fed although nothing moved"


def test_an_abstract_socket_and_somebody_elses_watchdog() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0skyfix-test-notify")
        listener.settimeout(1.0)
        notifier = Notifier({"NOTIFY_SOCKET": "@skyfix-test-notify", "WATCHDOG_USEC": "5", "WATCHDOG_PID": "1"})
        notifier.ready()
        assert listener.recv(500).startswith(b"READY=1")
        assert notifier.watchdog_s is None


def test_without_systemd_and_with_one_that_is_gone_nothing_happens(tmp_path: Path) -> None:
    Notifier({}).ready()
    Notifier({"NOTIFY_SOCKET": str(tmp_path / "gone")}).ready()


def test_each_must_move_by_itself() -> None:
    heartbeat = Heartbeat(patience_s=2.0)
    for second in range(5):
        still = heartbeat.beat({"moves": second, "hangs": 7}, float(second))
        assert still == (["hangs"] if second > 2 else [])
    assert heartbeat.beat({"moves": 99}, 9.0) == [], "what has ended is not waited for"
    assert heartbeat.beat({"moves": 99, "new": 0}, 10.0) == [], "what has just begun has time"
