"""The demo judges everything else, so its own parts are judged here."""

import io
import os
import select
import signal
import socket
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pynmeagps
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from calib.geodesy import enu_to_ecef, geodetic_to_enu
from calib.simulation.description import ObjectSpec
from calib.simulation.flight import ObjectFlight, flight
from calib.station import config as base_config
from calib.station.archive.scene_file import load
from calib.station.outputs.mavlink import dialect
from edge import config as box_config
from edge.common import settings
from edge.common.errors import SkyfixError
from tools.demo import SCENE, verdict
from tools.demonstration import site
from tools.demonstration.processes import Programs
from tools.demonstration.receivers import UNDULATION_M, epoch, receivers
from tools.demonstration.score import errors_m, followed_m, score
from tools.demonstration.screen import Screen, View
from tools.doubles.listener import Listener, Position

ORIGIN = (47.4085, 8.5071, 580.0)
START = 1_780_000_000 * 10**9
PORTS = site.Ports(zenoh=7447, mavlink=14550, status=8080)


@given(lat=st.floats(-89.9, 89.9), lon=st.floats(-179.9, 179.9), height=st.floats(-100, 5000))
def test_sentences_are_what_a_receiver_sends(lat: float, lon: float, height: float) -> None:
    at = datetime(2026, 6, 1, 10, 20, 30, 200_000, tzinfo=UTC)
    gga, gst, rmc = (pynmeagps.NMEAReader.parse(line + b"\r\n") for line in epoch(lat, lon, height, at).split())
    # pynmeagps rounds degrees to ten decimals; eight decimals of a minute are 8e-11 degrees.
    assert (gga.lat, gga.lon) == pytest.approx((lat, lon), abs=2e-10)
    assert gga.alt + gga.sep == pytest.approx(height, abs=2e-3)
    assert (gga.quality, gga.sep) == (4, UNDULATION_M)
    assert gst.stdAlt < 0.1
    assert rmc.date.isoformat() == "2026-06-01"


def test_minutes_never_read_sixty() -> None:
    line = epoch(46.9999999999999, 7.0, 500.0, datetime(2026, 6, 1, tzinfo=UTC)).split()[0]
    assert line.split(b",")[2] == b"4700.00000000"


def test_receivers_speak_on_real_ports_and_stay_where_they_are() -> None:
    antennas = [np.array([75.0, 5.0, 1.72]), np.array([-38.0, 72.0, 2.22])]
    with receivers(antennas, ORIGIN, seed=1) as devices:
        for antenna, device in zip(antennas, devices, strict=True):
            port = os.open(device, os.O_RDONLY | os.O_NOCTTY)
            try:
                text = b""
                while text.count(b"GNGGA") < 2 and select.select([port], [], [], 5.0)[0]:
                    text += os.read(port, 4096)
            finally:
                os.close(port)
            last = [line for line in text.split(b"\r\n") if line.startswith(b"$GNGGA") and b"*" in line][-1]
            gga = pynmeagps.NMEAReader.parse(last + b"\r\n")
            found = geodetic_to_enu(np.array([[gga.lat, gga.lon, gga.alt + gga.sep]]), ORIGIN)[0]
            assert found == pytest.approx(antenna, abs=0.06)  # six sigma of the worst axis


def test_configurations_are_accepted_by_the_programs(tmp_path: Path) -> None:
    scene = load(SCENE)
    for camera in scene.camera:
        inputs = site.Inputs(Path("/videos/a.mp4"), "/dev/pts/9", START)
        box = settings.parse(site.box(scene.name, camera, inputs, PORTS), box_config.BoxConfig, where="box")
        assert box.camera[0].source.t0_unix_ns == START + round(camera.phase_s * 1e9)
        assert box_config.load_lens(box.camera[0], tmp_path).intrinsics == camera.published_intrinsics
    base = base_config.checked(settings.parse(site.base(scene, PORTS), base_config.BaseConfig, where="base"), tmp_path)
    assert [camera.id for camera in base.camera] == ["cam0", "cam1", "cam2"]


# The listener


def test_listener_reads_what_the_station_writes() -> None:
    encoder = dialect.MAVLink(None)
    message = dialect.MAVLink_target_track_ecef_message(
        START // 1000, [1.5, 2.5, 3.5], [0.0] * 3, [0.0] * 21, 1.0, 7, 40, 3, 1, 0, 2, 3, 90
    )
    with Listener() as listener, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        heartbeat = common.MAVLink(None).heartbeat_encode(27, 8, 0, 0, 4)
        sender.sendto(heartbeat.pack(common.MAVLink(None)), ("127.0.0.1", listener.port))
        sender.sendto(b"\xfd\x00garbage", ("127.0.0.1", listener.port))
        sender.sendto(message.pack(encoder), ("127.0.0.1", listener.port))
        assert listener.wait(1, within_s=5.0)
        (position,) = listener.positions
        assert listener.counts["HEARTBEAT"] == 1
    assert (position.ecef_m, position.track, position.state, position.cameras) == ((1.5, 2.5, 3.5), 7, 2, 3)
    assert (position.time_ns, position.age_ns) == (START, 40_000_000)


# The verdict


@pytest.fixture
def flights() -> list[ObjectFlight]:
    drone = ObjectSpec(waypoints_enu=((0, 0, 30), (100, 0, 30)), step_s=10.0)
    bird = ObjectSpec(name="crow", kind="bird", waypoints_enu=((0, 60, 30), (100, 60, 40)), step_s=5.0)
    return [flight(drone), flight(bird)]


def positions(
    path: ObjectFlight, off_enu: tuple[float, float, float], track: int, *, first_s: float = 1.0
) -> list[Position]:
    t_s = np.arange(first_s, 4.9, 0.1)
    ecef = enu_to_ecef(path.position_enu(t_s) + off_enu, ORIGIN)
    times = [START + round(t * 1e9) for t in t_s.tolist()]
    return [
        Position(t + 30_000_000, t, 0, (x, y, z), track, 2, 3, 1, (0.0,) * 21)
        for t, (x, y, z) in zip(times, ecef.tolist(), strict=True)
    ]


def test_a_target_whose_object_has_landed_is_not_measured_against_another(flights: list[ObjectFlight]) -> None:
    heard = positions(flights[1], (0.1, 0, 0), 2)
    late = [heard[-1]._replace(time_ns=START + 7 * 10**9)]  # the bird landed after 5 s, the drone flies on
    error = errors_m(heard + late, flights, START, ORIGIN)
    found = followed_m(heard + late, error)
    assert found[:-1] == pytest.approx(0.1, abs=1e-6)
    assert error[-1].min() > 40
    assert np.isinf(found[-1])


def test_each_track_counts_for_the_object_it_follows(flights: list[ObjectFlight]) -> None:
    heard = positions(flights[0], (0.3, 0.0, 0.4), 1) + positions(flights[1], (0.0, 2.0, 0.0), 2)
    heard += positions(flights[0], (0.0, 0.0, 200.0), 3)
    result = score(heard, flights, START, ORIGIN)
    drone, crow = result.objects
    assert (drone.rmse_m, drone.tracks) == (pytest.approx(0.5, abs=1e-6), (1,))
    assert (crow.rmse_m, crow.tracks) == (pytest.approx(2.0, abs=1e-6), (2,))
    assert result.nobodys == (3,)
    assert result.latency_ms == pytest.approx((30.0, 30.0))
    assert drone.first_s == pytest.approx(1.03)
    assert result.passed


def test_a_track_that_goes_astray_counts_against_its_object(flights: list[ObjectFlight]) -> None:
    good = positions(flights[0], (0.0, 0.0, 0.0), 1)
    heard = good[:20] + positions(flights[0], (0.0, 0.0, 3.0), 1)[20:]
    result = score(heard, flights, START, ORIGIN)
    assert result.objects[0].rmse_m > 2.0
    assert not result.passed


def test_nothing_and_farewells_do_not_pass(flights: list[ObjectFlight]) -> None:
    assert not score([], flights, START, ORIGIN).passed
    farewell = [p._replace(state=4) for p in positions(flights[0], (0.0, 0.0, 0.0), 1)]
    assert not score(farewell, flights, START, ORIGIN).passed
    only_bird = score(positions(flights[1], (0.0, 0.0, 0.0), 1), flights, START, ORIGIN)
    assert not only_bird.passed
    assert "drone: no position" in verdict(only_bird, Path("out"), {})


def test_the_verdict_says_all_that_was_promised(flights: list[ObjectFlight], tmp_path: Path) -> None:
    (tmp_path / "recording").mkdir()
    (tmp_path / "recording" / "demo.mcap").touch()
    text = verdict(score(positions(flights[0], (0.1, 0.0, 0.0), 1), flights, START, ORIGIN), tmp_path, {"HEARTBEAT": 5})
    for words in ("first position 1.0 s", "RMSE 0.10 m", "p50 30 ms, p99 30 ms", "demo.mcap", "5 HEARTBEAT", "PASS"):
        assert words in text


# The screen


def view(elapsed_s: float, reason: str = "waiting for an object", heard: int = 0) -> View:
    camera = {
        "id": "cam0",
        "online": True,
        "last_frame_s": 0.1,
        "detections_per_frame": elapsed_s / 10,
        "surveyed": True,
        "calibrated": False,
        "suspect": "",
    }
    health = {"items": [{"level": "warn", "name": "security", "reason": "no TLS"}]}
    status = {"phase": "collecting", "reason": reason, "action": "fly", "cameras": [camera], "health": health}
    now = START + round(elapsed_s * 1e9)
    seen = [Position(now - 1, now - 2, 0, (0.0, 0.0, 0.0), 5, 2, 3, 1, (0.0,) * 21)] * heard
    return View(elapsed_s, 75.0, status, seen, np.full(heard, 0.25), now)


def test_a_pipe_gets_a_line_only_for_news(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    screen = Screen(stream)
    for k in range(20):
        screen.show(view(1.0 + k / 4))
    screen.show(view(6.5, reason="solving from 3 cameras", heard=4))
    text = stream.getvalue()
    assert "\x1b" not in text
    assert text.count("waiting for an object") == 1
    assert text.count("cam0") == 1
    assert text.count("no TLS") == 1
    assert "solving from 3 cameras" in text
    assert "target 5: seen by 3 cameras, 0.25 m from the truth; 4 positions so far" in text


def test_a_terminal_is_redrawn_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    screen = Screen(stream)
    screen.show(view(1.0))
    height = stream.getvalue().count("\n")
    screen.show(view(2.0))
    assert f"\x1b[{height}A" in stream.getvalue()
    monkeypatch.setenv("TERM", "dumb")
    assert not screen.can_redraw


# The processes


def test_a_program_that_dies_is_shown_with_its_last_words(tmp_path: Path) -> None:
    with Programs(tmp_path) as programs:
        died = programs.start("box", "python", "-c", "print('no camera here'); raise SystemExit(3)")
        died.process.wait(10)
        with pytest.raises(SkyfixError, match=r"box: ended with exit code 3.*\n.*no camera here"):
            programs.check()


def test_leaving_stops_everything_even_what_will_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.demonstration.processes.STOP_S", 0.5)
    deaf = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(60)"
    with Programs(tmp_path) as programs:
        polite = programs.start("polite", "python", "-c", "import time; time.sleep(60)")
        stubborn = programs.start("stubborn", "python", "-c", deaf)
        deadline = time.monotonic() + 10
        while "up" not in stubborn.log.read_text() and time.monotonic() < deadline:
            time.sleep(0.02)
    assert polite.code == -signal.SIGTERM
    assert stubborn.code == -signal.SIGKILL


def test_a_command_that_is_not_installed_is_named(tmp_path: Path) -> None:
    with Programs(tmp_path) as programs, pytest.raises(SkyfixError, match=r"make setup"):
        programs.start("box", "no-such-command")
