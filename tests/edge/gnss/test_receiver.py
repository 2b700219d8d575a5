"""The receiver's thread on real ptys, sockets and files: unplugged, silent, at the wrong rate, in others' hands."""

import datetime as dt
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import serial

from edge.common.errors import ConfigError
from edge.config import GnssConfig
from edge.gnss.diagnosis import ReceiverState, Watch
from edge.gnss.port import Fault, PortError, ReceiverPort, open_port
from edge.gnss.receiver import HUNG_S, Receiver, check_antenna
from tests.conftest import Until
from tools.doubles.receiver import Place, gga, rmc
from tools.doubles.serial_receiver import SerialReceiver

PLACE = Place()
RATE_HZ = 20.0  # of the simulated receiver's sentences; each says a second more, so that a test is soon old enough
CLEARING_S = 12.0  # limit of every wait: the longest patience built in is 3 s, the rest is a busy machine


def hurried_s() -> float:
    """Our own clock, four times as fast: patience of ten seconds is tried in two and a half."""
    return 4 * time.monotonic()


class Player(SerialReceiver):
    """GGA and RMC, each a second after the last by their own time, on a cable that is pulled and put back."""

    def __init__(self, link: Path) -> None:
        self.link = link
        super().__init__(lambda t: gga(t, PLACE) + rmc(t), period_s=1 / RATE_HZ, step_s=1.0, link=link)


@pytest.fixture
def player(tmp_path: Path) -> Iterator[Player]:
    """A player that is not plugged in yet."""
    player = Player(tmp_path / "receiver")
    yield player
    player.unplug()


@pytest.fixture
def started() -> Iterator[Callable[..., Receiver]]:
    """Start receivers that are stopped at the end."""
    receivers: list[Receiver] = []

    def start(device: object, **config: object) -> Receiver:
        receivers.append(Receiver(GnssConfig(device=str(device), **config), monotonic_s=hurried_s))  # type: ignore[arg-type]
        receivers[-1].start()
        return receivers[-1]

    yield start
    for receiver in receivers:
        receiver.close()


def test_a_fix_within_seconds_and_its_sigma_shrinks(
    player: Player, started: Callable[..., Receiver], until: Until
) -> None:
    player.plug()
    receiver = started(player.link, frame="EPSG:7931", lever_arm_m=(0.0, 0.0, 0.5))
    assert until(receiver.fix, within_s=CLEARING_S)
    first = receiver.fix()
    assert first is not None
    assert (first.quality, first.frame) == (4, "EPSG:7931")
    assert first.height_m == pytest.approx(PLACE.altitude_m + PLACE.separation_m - 0.5, abs=1e-3)
    assert first.lat_deg == pytest.approx(PLACE.lat_deg, abs=1e-8)
    assert until(lambda: (fix := receiver.fix()) and fix.samples > 3 * first.samples, within_s=CLEARING_S)
    later = receiver.fix()
    assert later is not None
    assert later.sigma_m < first.sigma_m


def test_unplugged_and_plugged_in_again(player: Player, started: Callable[..., Receiver], until: Until) -> None:
    receiver = started(player.link)
    assert until(lambda: receiver.status().state is ReceiverState.ABSENT, within_s=CLEARING_S)
    player.plug()
    assert until(lambda: (s := receiver.surveyed()) and s.mean.duration_s > 30, within_s=CLEARING_S)
    before_s = 30.0
    player.unplug()
    assert until(lambda: receiver.status().state in (ReceiverState.LOST, ReceiverState.ABSENT), within_s=CLEARING_S)
    assert receiver.fix() is None
    assert receiver.status().action
    player.plug()
    assert until(receiver.fix, within_s=CLEARING_S)
    surveyed = receiver.surveyed()
    assert surveyed is not None
    # Nobody knows whether the tripod stood still meanwhile: nothing from before is in the mean.
    assert surveyed.mean.duration_s < before_s


def test_silence(player: Player, started: Callable[..., Receiver], until: Until) -> None:
    player.say = lambda t: b""
    player.plug()
    receiver = started(player.link)
    assert until(lambda: receiver.status().state is ReceiverState.SILENT, within_s=CLEARING_S)
    assert "power" in receiver.status().action


def test_bytes_without_a_sentence_are_a_wrong_rate(
    player: Player, started: Callable[..., Receiver], until: Until
) -> None:
    player.say = lambda t: bytes(b ^ 0x81 for b in gga(t, PLACE))
    player.plug()
    receiver = started(player.link, baud=9600)
    assert until(lambda: receiver.status().state is ReceiverState.UNREADABLE, within_s=CLEARING_S)
    assert "9600" in receiver.status().reason
    assert "baud" in receiver.status().action


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"quality": 5}, "float"),
        ({"age": "30.0"}, "too old"),
        ({"separation": ""}, "separation"),
        ({"decimals": 5}, "decimals"),
    ],
)
def test_a_receiver_that_is_not_good_enough_says_why(
    player: Player, started: Callable[..., Receiver], until: Until, fields: dict[str, object], words: str
) -> None:
    player.say = lambda t: gga(t, PLACE, **fields)  # type: ignore[arg-type]
    player.plug()
    receiver = started(player.link)
    assert until(lambda: words in receiver.status().reason, within_s=CLEARING_S)
    assert receiver.status().action
    assert receiver.fix() is None


def test_corrections_that_stop_withdraw_the_fix(player: Player, started: Callable[..., Receiver], until: Until) -> None:
    player.plug()
    receiver = started(player.link)
    assert until(receiver.fix, within_s=CLEARING_S)
    player.say = lambda t: gga(t, PLACE, quality=5)
    assert until(lambda: receiver.status().state is ReceiverState.NO_FIX, within_s=2 * CLEARING_S)
    assert receiver.fix() is None


def test_opened_exclusively(player: Player, started: Callable[..., Receiver], until: Until) -> None:
    player.plug()
    with serial.Serial(str(player.link), exclusive=True):
        receiver = started(player.link)
        assert until(lambda: receiver.status().state is ReceiverState.BUSY, within_s=CLEARING_S)
        assert "ModemManager" in receiver.status().action
    assert until(receiver.fix, within_s=CLEARING_S)


def test_a_tcp_stream_that_breaks_and_comes_back(
    tmp_path: Path, started: Callable[..., Receiver], until: Until
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        receiver = started(f"socket://127.0.0.1:{server.getsockname()[1]}")
        t = dt.datetime.now(dt.UTC).replace(microsecond=0)
        for _ in range(2):
            connection, _ = server.accept()
            with connection:

                def speak(connection: socket.socket = connection) -> object:
                    nonlocal t
                    t += dt.timedelta(seconds=1)
                    connection.sendall(gga(t, PLACE))
                    return receiver.fix()

                assert until(speak, within_s=CLEARING_S)
            assert until(lambda: receiver.status().state is ReceiverState.LOST, within_s=CLEARING_S)
    assert until(lambda: receiver.status().state is ReceiverState.REFUSED, within_s=CLEARING_S)


def test_a_recording(tmp_path: Path, started: Callable[..., Receiver], until: Until) -> None:
    recording = tmp_path / "recorded.nmea"
    t = dt.datetime(2019, 8, 1, 12, 0, 0, tzinfo=dt.UTC)
    recording.write_bytes(b"".join(gga(t + dt.timedelta(seconds=i), PLACE) for i in range(30)))
    receiver = started(recording)
    assert until(lambda: receiver.status().state is ReceiverState.ENDED, within_s=CLEARING_S)
    fix = receiver.fix()
    assert fix is not None
    assert (fix.samples, receiver.status().level) == (30, "ok")


def test_stopping_takes_no_time_whatever_the_state(player: Player, started: Callable[..., Receiver]) -> None:
    player.plug()
    for device in (player.link, "/dev/no-such-device", "socket://127.0.0.1:1"):
        receiver = started(device)
        before = time.monotonic()
        receiver.close()
        assert time.monotonic() - before < 2.0
        receiver.close()


class ScriptedPort:
    """A line that is only readable at one rate: what a pty cannot show."""

    def __init__(self, baud: int, right: int, started_s: float) -> None:
        self._readable = baud == right
        self._t = dt.datetime.now(dt.UTC).replace(microsecond=0) + dt.timedelta(seconds=round(started_s) % 1000)

    def read(self) -> bytes:
        """A sentence a millisecond, or what the wrong rate makes of it."""
        time.sleep(0.001)
        self._t += dt.timedelta(seconds=1)
        return gga(self._t, PLACE) if self._readable else b"\x9c\x00\xf8" * 20

    def close(self) -> None:
        """Nothing to close."""


def test_the_rate_is_found(until: Until) -> None:
    tried: list[int] = []
    clock = {"s": 0.0}

    def opener(device: str, baud: int) -> ReceiverPort:
        tried.append(baud)
        return ScriptedPort(baud, 460800, clock["s"])

    def stepping_s() -> float:
        clock["s"] += 0.05
        return clock["s"]

    receiver = Receiver(GnssConfig(device="/dev/scripted", baud=0), opener=opener, monotonic_s=stepping_s)
    receiver.start()
    try:
        assert until(receiver.fix, within_s=CLEARING_S)
    finally:
        receiver.close()
    assert tried == [115200, 38400, 460800]


@pytest.mark.parametrize("raised", [OSError(5, "I/O"), serial.SerialException("gone"), TypeError("closed meanwhile")])
def test_whatever_a_driver_raises_is_a_port_error(raised: Exception, until: Until) -> None:
    class Dying:
        port = "/dev/dying"

        def read(self, size: int) -> bytes:
            raise raised

        def close(self) -> None:
            raise raised

    from edge.gnss.port import SerialPort  # noqa: PLC0415

    receiver = Receiver(GnssConfig(device="/dev/dying"), opener=lambda d, b: SerialPort(Dying()))  # type: ignore[arg-type]
    receiver.start()
    try:
        assert until(lambda: receiver.status().state is ReceiverState.LOST)
    finally:
        receiver.close()


def test_what_a_driver_that_hangs_said_last_is_not_said_for_ever(until: Until) -> None:
    """A USB bridge that stops in the middle of a read: no byte, no error, and a thread that cannot know."""
    hangs, stuck, clock = threading.Event(), threading.Event(), {"ahead_s": 0.0}

    class Hanging(ScriptedPort):
        def read(self) -> bytes:
            while hangs.is_set():
                stuck.set()
                time.sleep(0.01)
            return super().read()

    receiver = Receiver(
        GnssConfig(device="/dev/hanging"),
        opener=lambda device, baud: Hanging(baud, baud, 0.0),
        monotonic_s=lambda: time.monotonic() + clock["ahead_s"],
    )
    receiver.start()
    try:
        assert until(lambda: receiver.fix() and (said := receiver.said()) and said.standing == "held")
        hangs.set()
        assert stuck.wait(5.0)
        clock["ahead_s"] = HUNG_S + 1
        said = receiver.said()
        assert said is not None
        assert (said.standing, said.quality) == ("unconfirmed", 0)
        assert receiver.fix() is None
        assert (receiver.status().level, "has not answered" in receiver.status().reason) == ("fail", True)
        hangs.clear()
        assert until(receiver.fix)
    finally:
        hangs.clear()
        receiver.close()


def test_a_base_that_is_switched_while_the_antenna_settles_is_remembered() -> None:
    """Carried, three quarters of a minute at rest, and then the caster hands out another base: nothing was said yet."""
    now = {"s": 0.0}
    receiver = Receiver(GnssConfig(device="/dev/none"), monotonic_s=lambda: now["s"])
    watch = Watch(0.0, 115200, 0)
    start = dt.datetime.now(dt.UTC).replace(microsecond=0)
    for second in range(60 + 30 + 45 + 700):
        east_m = min(max(second - 60, 0), 30) * 0.5 + (1.3 if second >= 135 else 0.0)
        for data, at_s in ((gga(start + dt.timedelta(seconds=second), PLACE, np.array([east_m, 0, 0])), 0), (b"", 0.5)):
            now["s"] = second + at_s
            if second % 5:
                watch.last_snapshot_s = now["s"]  # a look every five seconds is enough
            receiver._take(data, watch)
    fix = receiver.fix()
    assert fix is not None
    assert fix.sigma_m[0] > 1.2
    assert "one of the two is false" in receiver.status().reason
    receiver._session.moves += 1  # it wanders by centimetres: that explains no metre
    again = gga(start + dt.timedelta(seconds=835), PLACE, np.array([16.3, 0, 0]))
    now["s"] = 835.0
    receiver._take(again, watch)
    fix = receiver.fix()
    assert fix is not None
    assert fix.sigma_m[0] > 1.2


def test_no_permission(tmp_path: Path) -> None:
    missing = tmp_path / "none"
    with pytest.raises(PortError) as caught:
        open_port(str(missing), 115200)
    assert caught.value.fault is Fault.ABSENT
    with pytest.raises(PortError):
        open_port("nonsense://x", 115200)


def test_an_antenna_beside_the_lens_is_refused() -> None:
    with pytest.raises(ConfigError, match="beside the lens"):
        Receiver(GnssConfig(device="/dev/x", lever_arm_m=(0.1, 0.0, 0.2)))


def test_a_box_says_whether_it_knows_where_its_antenna_stands() -> None:
    assert check_antenna(GnssConfig(device="/dev/x", lever_arm_m=(0.0, 0.0, 0.12))).level == "ok"
    unknown = check_antenna(GnssConfig(device="/dev/x"))
    assert unknown.level == "warn"
    assert "gnss.lever_arm_m" in unknown.action


def test_a_position_is_not_stood_by_while_the_newest_epoch_speaks_against_it(
    player: Player, started: Callable[..., Receiver], until: Until
) -> None:
    player.plug()
    receiver = started(player.link)
    assert until(lambda: (fix := receiver.said()) and fix.samples >= 30, within_s=CLEARING_S)
    player.say = lambda t: gga(t, PLACE, quality=5)
    assert until(lambda: (said := receiver.said()) and said.standing == "unconfirmed", within_s=CLEARING_S)
    player.say = lambda t: gga(t, PLACE) + rmc(t)
    assert until(lambda: (said := receiver.said()) and said.standing == "held", within_s=CLEARING_S)
    moved_m = [0.0]

    def carried(t: dt.datetime) -> bytes:
        moved_m[0] += 0.5
        return gga(t, PLACE, np.array([moved_m[0], 0.0, 0.0]))

    player.say = carried
    assert until(lambda: (said := receiver.said()) and said.standing == "doubted", within_s=CLEARING_S)
    said = receiver.said()
    assert said is not None
    assert said.quality == 0
    assert "jumps" in said.why
