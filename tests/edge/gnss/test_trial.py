"""A receiver tried until it is clear how it is: healthy, float, silent, noise and none are told apart."""

import os
from pathlib import Path

import pytest

from edge.common.health import HealthLevel
from edge.config import GnssConfig
from edge.gnss.diagnosis import ReceiverState
from edge.gnss.receiver import Receiver
from edge.gnss.trial import try_receiver
from tools.doubles.receiver import Place, gga, rmc
from tools.doubles.serial_receiver import Say, SerialReceiver

PLACE = Place()
HEALTHY: Say = lambda t: gga(t, PLACE) + rmc(t)  # noqa: E731
SAYS: dict[str, tuple[Say, ReceiverState, HealthLevel, str]] = {
    "healthy": (HEALTHY, ReceiverState.AVERAGING, "warn", "clock"),  # its seconds are hurried: its UTC is ahead
    "float": (lambda t: gga(t, PLACE, quality=5), ReceiverState.NO_FIX, "warn", "RTK float"),
    "no correction": (lambda t: gga(t, PLACE, quality=1), ReceiverState.NO_FIX, "warn", "single"),
    "silent": (lambda t: b"", ReceiverState.SILENT, "fail", "no byte"),
    "noise": (lambda t: os.urandom(200), ReceiverState.UNREADABLE, "fail", "baud"),
}


@pytest.mark.parametrize("kind", SAYS)
def test_each_kind_is_told_apart(kind: str) -> None:
    say, state, level, words = SAYS[kind]
    seen: list[str] = []
    with SerialReceiver(say, period_s=0.1, step_s=1.0) as line:
        status = try_receiver(Receiver(GnssConfig(device=line.device)), seen.append)
    assert (status.state, status.level) == (state, level)
    assert words in status.reason
    assert status.action
    assert seen
    assert "of at most" in seen[0]


def test_none_is_said_at_once(tmp_path: Path) -> None:
    status = try_receiver(Receiver(GnssConfig(device=str(tmp_path / "none"))))
    assert (status.state, status.level) == (ReceiverState.ABSENT, "fail")


def test_a_healthy_one_says_its_sky_and_its_sigma() -> None:
    with SerialReceiver(HEALTHY, period_s=1.0) as line:
        status = try_receiver(Receiver(GnssConfig(device=line.device)))
    assert (status.state, status.level) == (ReceiverState.AVERAGING, "ok")
    for words in ("RTK fixed", "satellites", "corrections 1 s old", "mm horizontal", "mm vertical"):
        assert words in status.reason
