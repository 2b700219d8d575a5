"""A real station in the test's own process: real Zenoh on loopback, real sockets, a solver that knows the answer."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import tomli_w
from pymavlink.dialects.v20 import common

import calib.station.outputs.mavlink.messages  # noqa: F401 -- registers the dialect with pymavlink's parser
from calib.network import Network
from calib.observations import Scene
from calib.station import config
from calib.station.archive.state_store import StateStore
from calib.station.config import BaseConfig
from calib.station.core.calibration import reduced
from calib.station.core.jobs import Solved
from calib.station.runner import Runner
from tools.doubles.box_messages import SITE
from tools.doubles.flight import ORIGIN, Spec, make

SPEC: Final = Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=60.0)
KNOWN: Final = "tests.calib.station.running:known_solution"  # by name: the solving process loads it


def known_solution(scene: Scene, start: Network | None) -> Solved:
    """A solver that is told the answer."""
    return Solved(reduced(make(SPEC).network, {camera.id for camera in scene.cameras}), 0.1)


def configured(folder: Path, endpoint: str, **sections: Any) -> BaseConfig:
    """base.toml, written and read as a user's: the bench's site, whose boxes dial `endpoint`."""
    told: dict[str, Any] = {
        "state_folder": "state",
        "site": {"name": SITE, "origin": list(ORIGIN), "undulation_m": 47.0},
        "camera": [{"id": f"cam{k}"} for k in range(SPEC.cameras)],
        "link": {"listen": [endpoint]},
        "calibration": {"first_solve_s": 3.0},
        "recording": {"folder": "recordings", "min_free_mb": 1},
        "status": {"port": 0},
    }
    (folder / "base.toml").write_text(tomli_w.dumps(told | sections))
    return config.load(folder / "base.toml")


def calibrated_before(folder: Path) -> None:
    """The state of a station that has calibrated the scene's cameras in an earlier run."""
    with StateStore(folder / "state") as keeper:
        keeper.store_network(make(SPEC).network)


@dataclass
class UdpEar:
    """A receiver of datagrams on a port of its own, and the MAVLink messages in them."""

    socket: socket.socket
    parser: Any = field(default_factory=lambda: common.MAVLink(None))
    messages: list[Any] = field(default_factory=list)

    @property
    def port(self) -> int:
        return int(self.socket.getsockname()[1])

    @property
    def endpoint(self) -> dict[str, Any]:
        """As [mavlink] has it."""
        return {"url": f"udp:127.0.0.1:{self.port}", "profile": ["gcs", "ecef"]}

    def datagrams(self) -> list[bytes]:
        """What came since the last call."""
        found = []
        while True:
            try:
                found.append(self.socket.recv(4096))
            except BlockingIOError:
                return found

    def kinds(self) -> list[str]:
        """Of all MAVLink messages that came so far."""
        for datagram in self.datagrams():
            self.messages += self.parser.parse_buffer(datagram) or []
        return [message.get_type() for message in self.messages]

    def forget(self) -> None:
        """Only what comes from now on counts."""
        self.kinds()
        self.messages.clear()


@contextmanager
def udp_ear() -> Iterator[UdpEar]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        own.setblocking(False)
        yield UdpEar(own)


@contextmanager
def running(config: BaseConfig, folder: Path) -> Iterator[Runner]:
    """The station; turn it with `turned_until`."""
    with ExitStack() as stack:
        yield Runner(config, folder, stack, KNOWN)


def turned_until(runner: Runner, condition: Callable[[], object], within_s: float = 20.0) -> bool:
    """Let the loop turn until a condition holds; whether it came to hold in time."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        runner.turn()
        if condition():
            return True
    return False
