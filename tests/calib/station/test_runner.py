"""The loop in process, with real Zenoh, sockets, files and solving process: what comes in, goes out, and goes wrong."""

import socket
from pathlib import Path

import msgspec
import numpy as np
import pytest

from calib.station.archive import recording
from calib.station.core.calibration import Phase
from calib.station.display import Display
from calib.station.outputs.guarded import GuardedOutput
from calib.station.outputs.mavlink.identity import PRIVATE_COMPONENTS
from calib.station.outputs.outputs import Outputs
from calib.station.page.wire import OperatorCommand
from calib.station.runner import Runner
from calib.station.standing import STALLED_NS
from calib.station.status.status import StationStatus
from tests.calib.station.outputs.misbehaving import Misbehaving
from tests.calib.station.running import SPEC, UdpEar, calibrated_before, configured, running, turned_until, udp_ear
from tools.doubles.feed import boxes
from tools.doubles.flight import ORIGIN, make

MISBEHAVING = "tests.calib.station.outputs.misbehaving"


def items(runner: Runner) -> dict[str, str]:
    """Level of each health line, by name."""
    health = runner.station.health
    return {} if health is None else {item.name: item.level for item in health.items}


def beats(runner: Runner, ear: UdpEar, turns_of_a_second: int = 3) -> int:
    """Heartbeats in so many rounds of a second."""
    ear.forget()
    seconds = 0
    while seconds < turns_of_a_second:
        seconds += runner.turn()
    return ear.kinds().count("HEARTBEAT")


def test_a_station_that_was_calibrated_sends_what_its_cameras_see(tmp_path: Path, endpoint: str) -> None:
    calibrated_before(tmp_path)
    scene = make(SPEC)
    with udp_ear() as ear:
        config = configured(tmp_path, endpoint, mavlink={"endpoint": [ear.endpoint]})
        with running(config, tmp_path) as runner, boxes(scene, endpoint):
            assert turned_until(runner, lambda: ear.kinds().count("TARGET_TRACK_ECEF") > 10)
            assert turned_until(runner, lambda: "TRACKER_STATUS" in ear.kinds()[-200:] and runner.station.health)
            status = runner.status()
            assert turned_until(runner, lambda: ear.kinds().count("ADSB_VEHICLE") > 1)
        track = next(m for m in ear.messages if m.get_type() == "TARGET_TRACK_ECEF")
        assert track.get_srcComponent() in PRIVATE_COMPONENTS
        assert (status.phase, status.site, status.first_solve_s) == ("calibrated", "bench", 3.0)
        assert [camera.online for camera in status.cameras] == [True] * 3
        assert status.latency_ms is not None
        assert status.latency_ms[0] < 1000.0  # a loop that works, on a busy machine
        assert status.counters["mavlink_sent"] > 10
        assert status.counters["mavlink_failed_calls"] == 0
        assert [each.content for each in status.endpoints] == ["gcs+ecef"]


def test_all_that_came_and_went_is_recorded(tmp_path: Path, endpoint: str) -> None:
    calibrated_before(tmp_path)
    with udp_ear() as ear:
        config = configured(tmp_path, endpoint, mavlink={"endpoint": [ear.endpoint]})
        with running(config, tmp_path) as runner, boxes(make(SPEC), endpoint):
            assert turned_until(runner, lambda: ear.kinds().count("TARGET_TRACK_ECEF") > 10)
            assert turned_until(runner, runner.turn)
    (file,) = (tmp_path / "recordings").glob("*.mcap")
    kept = list(recording.read(file))
    topics = {message.key.rpartition("/")[2] for message in kept}
    assert {"tracks", "lens", "fix", "targets", "network", "health", "calibration", "mavlink"} <= topics
    frames = [bytes.fromhex(msgspec.json.decode(m.payload)["frame"]) for m in kept if m.key.endswith("/mavlink")]
    received = [bytes(message.get_msgbuf()) for message in ear.messages]
    assert set(received) <= set(frames)
    assert np.all(np.diff([message.t_arrival_ns for message in kept if message.key.endswith("/mavlink")]) >= 0)


def test_it_calibrates_and_keeps_what_it_found(tmp_path: Path, endpoint: str) -> None:
    output = {"counting": {"module": MISBEHAVING}}
    with running(configured(tmp_path, endpoint, output=output), tmp_path) as runner, boxes(make(SPEC), endpoint):
        assert runner.station.standing.phase is Phase.COLLECTING
        assert turned_until(runner, lambda: runner.station.standing.phase is Phase.CALIBRATED, within_s=60)
        assert runner.station.calibration.network is not None
        assert runner.station.calibration.network.origin == pytest.approx(ORIGIN)
    assert (tmp_path / "state" / "network.toml").is_file()
    with running(configured(tmp_path, endpoint), tmp_path) as again:
        assert again.epoch == 2


def test_no_heartbeat_while_the_link_cannot_be_opened(tmp_path: Path, endpoint: str) -> None:
    """Another program holds the port: no box can reach this station, and it must not look alive."""
    host, port = endpoint.removeprefix("tcp/").split(":")
    with udp_ear() as ear:
        config = configured(tmp_path, endpoint, mavlink={"endpoint": [ear.endpoint]})
        with socket.create_server((host, int(port))) as holder, running(config, tmp_path) as runner:
            assert turned_until(runner, lambda: items(runner).get("link") == "fail")
            assert beats(runner, ear) == 0
            assert "TRACKER_STATUS" in ear.kinds()
            holder.close()
            assert turned_until(runner, lambda: runner.boxes.link.wait_open(0.0))
            assert beats(runner, ear) >= 4  # two components


def test_no_heartbeat_after_the_loop_stood_still(tmp_path: Path, endpoint: str) -> None:
    with udp_ear() as ear:
        config = configured(tmp_path, endpoint, mavlink={"endpoint": [ear.endpoint]})
        with running(config, tmp_path) as runner:
            assert turned_until(runner, lambda: runner.boxes.link.wait_open(0.0))
            assert beats(runner, ear, 2) >= 2
            slow = Misbehaving("sleeps", 1.1 * STALLED_NS * 1e-9)
            runner.outputs = Outputs([runner.outputs, GuardedOutput("slow", slow)])  # called from within the loop
            assert turned_until(runner, lambda: not slow.how)  # it has slept
            assert beats(runner, ear, 1) == 0
            assert turned_until(runner, lambda: items(runner)["loop"] == "fail")
            assert beats(runner, ear, 2) >= 2


def test_one_output_that_raises_and_one_that_hangs_silence_nobody(tmp_path: Path, endpoint: str) -> None:
    calibrated_before(tmp_path)
    wrong = {"raising": {"module": MISBEHAVING, "how": "raises"}, "hanging": {"module": MISBEHAVING, "how": "hangs"}}
    with udp_ear() as ear:
        config = configured(tmp_path, endpoint, output=wrong, mavlink={"endpoint": [ear.endpoint]})
        with running(config, tmp_path) as runner, boxes(make(SPEC), endpoint):
            assert turned_until(runner, lambda: ear.kinds().count("TARGET_TRACK_ECEF") > 30)
            assert turned_until(runner, lambda: items(runner).get("output raising") == "warn")
            assert turned_until(runner, lambda: items(runner).get("output hanging") == "warn")
            assert runner.status().counters["raising_failed_calls"] > 0


class OneCommand:
    """A page on which the operator has pressed one button."""

    def __init__(self, command: OperatorCommand) -> None:
        self.waiting = [command]
        self.fed: set[str] = set()
        self.shown: list[StationStatus] = []
        self.watched = True

    def due(self) -> bool:
        return True

    def show(self, status: StationStatus) -> None:
        self.shown.append(status)

    def feed(self, name: str, payload: bytes, *, keep: bool = False) -> None:
        self.fed.add(name)

    def commands(self) -> list[OperatorCommand]:
        waiting, self.waiting = self.waiting, []
        return waiting


def test_what_the_operator_wants_is_done_and_shown(tmp_path: Path, endpoint: str) -> None:
    calibrated_before(tmp_path)
    with running(configured(tmp_path, endpoint), tmp_path) as runner, boxes(make(SPEC), endpoint):
        page = OneCommand(OperatorCommand(do="mute", camera="cam1"))
        runner.display = Display(runner.boxes.link, "bench", page, page)
        assert turned_until(runner, lambda: page.shown and page.shown[-1].recording is not None)
        assert [camera.muted for camera in page.shown[-1].cameras] == [False, True, False]
        page.waiting = [OperatorCommand(do="unmute", camera="cam1"), OperatorCommand(do="stop")]
        assert turned_until(runner, lambda: page.shown[-1].recording is None)
        assert not any(camera.muted for camera in page.shown[-1].cameras)
        written = runner.recording.messages
        assert turned_until(runner, lambda: {"targets", "network", "tracks/cam0"} <= page.fed)
        assert runner.recording.messages == written
        page.waiting = [OperatorCommand(do="record"), OperatorCommand(do="mute", camera="nobody")]
        assert turned_until(runner, lambda: runner.recording.messages > written)
        assert runner.station.muted == set()
