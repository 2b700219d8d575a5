"""The real program over real Zenoh and UDP: positions from a stored network, killed and back, stopped in time."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from calib.geodesy import ecef_to_enu
from calib.station.archive import recording
from tools.doubles.base import Base, scene_config
from tools.doubles.feed import boxes
from tools.doubles.flight import ORIGIN, Scene, Spec, make
from tools.doubles.listener import Listener, Position

SPEC = Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=60.0)
BACK_WITHIN_S = 30.0  # 5 s on a quiet computer (tools.bench.field kills); here only a hang may fail


@pytest.fixture
def listener() -> Iterator[Listener]:
    with Listener() as listening:
        yield listening


@pytest.fixture
def base(tmp_path: Path, endpoint: str, listener: Listener) -> Iterator[Base]:
    """A base with the network an earlier run left; gone after the test, however it ends."""
    scene = make(SPEC)
    mavlink = {"endpoint": [{"url": listener.url, "profile": ["gcs", "ecef"]}]}
    base = Base(tmp_path, scene_config(scene, endpoint, mavlink=mavlink), scene.network)
    yield base
    base.kill()


@pytest.fixture
def feeding(endpoint: str) -> Iterator[Scene]:
    """Boxes that send the scene from now on, whether anybody listens or not."""
    scene = make(SPEC)
    with boxes(scene, endpoint):
        yield scene


def error_m(scene: Scene, position: Position) -> float:
    where = ecef_to_enu(np.array([position.ecef_m]), ORIGIN)[0]
    return float(np.linalg.norm(scene.positions(position.time_ns) - where, axis=1).min())


def test_positions_survive_kill_9_and_the_end_is_in_order(base: Base, feeding: Scene, listener: Listener) -> None:
    base.start()
    assert listener.wait(20, BACK_WITHIN_S), base.log()
    base.kill()
    before = len(listener.positions)
    killed_ns = time.time_ns()
    base.start()
    assert listener.wait(before + 20, BACK_WITHIN_S), base.log()
    back_s = (listener.positions[before].received_ns - killed_ns) * 1e-9
    assert back_s < BACK_WITHIN_S
    asked = time.monotonic()
    assert base.stop() == 0
    assert time.monotonic() - asked < 6.0  # 3 s of its own; a loaded computer may take as long again
    assert "Traceback" not in base.log()

    # Both runs told the truth, under track numbers and epochs of their own.
    heard = listener.positions
    assert max(error_m(feeding, position) for position in heard) < 1.0
    numbers = [{position.track for position in part} for part in (heard[:before], heard[before + 5 :])]
    assert numbers[0].isdisjoint(numbers[1])
    assert {position.epoch for position in heard} == {1, 2}
    assert {"HEARTBEAT", "SYSTEM_TIME", "TRACKER_STATUS", "ADSB_VEHICLE"} <= set(listener.counts)

    # The killed run's recording is whole up to its last message, the other has its end.
    killed_run, stopped_run = sorted((base.folder / "recordings").glob("*.mcap"))
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
