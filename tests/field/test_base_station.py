"""The real program over real Zenoh and UDP: positions from a stored network, killed and back, stopped in time."""

import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from pymavlink.dialects.v20 import common

import calib.station.outputs.mavlink.messages  # noqa: F401 -- registers the dialect with pymavlink's parser
from calib.geodesy import ecef_to_enu
from calib.station.archive import recording
from calib.station.archive.state_store import StateStore
from tools.doubles.box_messages import SITE
from tools.doubles.feed import boxes
from tools.doubles.flight import ORIGIN, Scene, Spec, make

SPEC = Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=60.0)
BACK_WITHIN_S = 30.0  # 5 s on a quiet computer (tools.bench.field kills); here only a hang may fail


class Listener:
    """An independent receiver on UDP: TARGET_TRACK_ECEF with the time it came."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.1)
        self.port = self.socket.getsockname()[1]
        self.tracks: list[tuple[float, common.MAVLink_message]] = []
        self.kinds: set[str] = set()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.socket.close()

    def _listen(self) -> None:
        parser = common.MAVLink(None)
        parser.robust_parsing = True
        while not self._stop.is_set():
            try:
                data = self.socket.recv(4096)
            except TimeoutError:
                continue
            for message in parser.parse_buffer(data) or []:
                self.kinds.add(message.get_type())
                if message.get_type() == "TARGET_TRACK_ECEF":
                    self.tracks.append((time.monotonic(), message))

    def wait(self, count: int, within_s: float) -> bool:
        deadline = time.monotonic() + within_s
        while time.monotonic() < deadline and len(self.tracks) < count:
            time.sleep(0.02)
        return len(self.tracks) >= count


@pytest.fixture
def listener() -> Iterator[Listener]:
    made = Listener()
    yield made
    made.close()


@pytest.fixture
def folder(tmp_path: Path, endpoint: str, listener: Listener) -> Path:
    """A configuration, and the network an earlier run left."""
    cameras = "".join(f'[[camera]]\nid = "cam{k}"\n' for k in range(SPEC.cameras))
    (tmp_path / "base.toml").write_text(
        f'state_folder = "state"\n[site]\nname = "{SITE}"\nundulation_m = 47.0\norigin = {list(ORIGIN)}\n{cameras}'
        f'[link]\nlisten = ["{endpoint}"]\n[recording]\nfolder = "recordings"\n[status]\nport = 0\n'
        f'[[mavlink.endpoint]]\nurl = "udp:127.0.0.1:{listener.port}"\nprofile = ["gcs", "ecef"]\n'
    )
    (tmp_path / "state").mkdir()
    with StateStore(tmp_path / "state") as keeper:
        keeper.store_network(make(SPEC).network)
    return tmp_path


@pytest.fixture
def start(folder: Path) -> Iterator[Callable[[], "subprocess.Popen[bytes]"]]:
    """Start a base station; all of them are gone after the test, however it ends."""
    started: list[subprocess.Popen[bytes]] = []
    command = [sys.executable, "-m", "calib.station.app", "run", "--config", str(folder / "base.toml")]

    def make_one() -> subprocess.Popen[bytes]:
        started.append(subprocess.Popen(command, stderr=log))
        return started[-1]

    with (folder / "log.txt").open("ab") as log:
        yield make_one
        for process in started:
            process.kill()
            process.wait()


@pytest.fixture
def feeding(endpoint: str) -> Iterator[Scene]:
    """Boxes that send the scene from now on, whether anybody listens or not."""
    scene = make(SPEC)
    with boxes(scene, endpoint):
        yield scene


def error_m(scene: Scene, message: common.MAVLink_message) -> float:
    where = ecef_to_enu(np.array([message.pos]), ORIGIN)[0]
    return float(np.linalg.norm(scene.positions(message.time_usec * 1000) - where, axis=1).min())


def test_positions_survive_kill_9_and_the_end_is_in_order(
    folder: Path, start: Callable[[], "subprocess.Popen[bytes]"], feeding: Scene, listener: Listener
) -> None:
    first = start()
    assert listener.wait(20, BACK_WITHIN_S), (folder / "log.txt").read_text()
    first.send_signal(signal.SIGKILL)
    first.wait()
    before = len(listener.tracks)
    killed = time.monotonic()
    second = start()
    assert listener.wait(before + 20, BACK_WITHIN_S), (folder / "log.txt").read_text()
    back_s = listener.tracks[before][0] - killed
    assert back_s < BACK_WITHIN_S
    asked = time.monotonic()
    second.send_signal(signal.SIGTERM)
    assert second.wait(10.0) == 0
    assert time.monotonic() - asked < 6.0  # 3 s of its own; a loaded computer may take as long again
    assert "Traceback" not in (folder / "log.txt").read_text()

    # Both runs told the truth, under track numbers and epochs of their own.
    assert max(error_m(feeding, message) for _, message in listener.tracks) < 1.0
    numbers = [{m.track_id for _, m in part} for part in (listener.tracks[:before], listener.tracks[before + 5 :])]
    assert numbers[0].isdisjoint(numbers[1])
    assert {m.epoch for _, m in listener.tracks} == {1, 2}
    assert {"HEARTBEAT", "SYSTEM_TIME", "TRACKER_STATUS", "ADSB_VEHICLE"} <= listener.kinds

    # The killed run's recording is whole up to its last message, the other has its end.
    killed_run, stopped_run = sorted((folder / "recordings").glob("*.mcap"))
    for path in (killed_run, stopped_run):
        keys = {message.key.rpartition("/")[2] for message in recording.read(path)}
        assert {"tracks", "targets", "network", "health", "mavlink", "calibration"} <= keys
    for message in recording.read(killed_run):
        msgspec.json.decode(message.payload)


def test_a_wrong_configuration_is_exit_code_2_and_one_line(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text('[site]\nname = "x"\nundulaton_m = 3\n')
    command = [sys.executable, "-m", "calib.station.app", "run", "--config", str(tmp_path / "base.toml")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "site.undulaton_m" in done.stderr
    assert "undulation_m" in done.stderr
