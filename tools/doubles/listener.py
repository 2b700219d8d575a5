"""An independent receiver of the station's MAVLink: plain pymavlink on a UDP socket, nothing of Skyfix in it.

The private messages are decoded with code generated here and now from the dialect's XML, not with the module that the
station encodes them with: a message that only its own author can read would not pass.
"""

import importlib.util
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import common

from edge.common.own_thread import OwnThread
from tools.make_dialect import XML, generate

POLL_S: Final = 0.1  # s between looks at whether to stop
CLOSE_S: Final = 2.0
LARGEST: Final = 65536  # bytes of a UDP datagram
LOST: Final = 4  # TRACK_STATE_LOST: a farewell, not a position
SINCE_2015_S: Final = 1_420_070_400  # UTC s at which signatures begin to count, in ticks of 10 us


class Position(NamedTuple):
    """One TARGET_TRACK_ECEF as it arrived. received_ns: UTC; time_ns: of validity; age_ns: of the last measurement.

    covariance: upper triangle of the 6 x 6, ECEF, row by row.
    """

    received_ns: int
    time_ns: int
    age_ns: int
    ecef_m: tuple[float, float, float]
    track: int
    state: int
    cameras: int
    epoch: int
    covariance: tuple[float, ...]


class Listener(OwnThread):
    """Receives in a thread of its own. Use as a context manager."""

    def __init__(self, port: int = 0, *, key: bytes | None = None, but_system: int = -1) -> None:
        """port: 0 for any. key: as stock pymavlink verifies, told the time now. but_system: counted as "others"."""
        super().__init__("mavlink-listener", CLOSE_S)
        # One map for both: the standard messages, and the private ones as the XML defines them.
        common.mavlink_map.update(_dialect().mavlink_map)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(POLL_S)
        self._signing: Any = common.MAVLink(None).signing
        if key is not None:
            self._signing.secret_key = key
            self._signing.timestamp = int((time.time() - SINCE_2015_S) * 1e5)
        self._but = but_system
        self._came = threading.Condition()
        self._positions: list[Position] = []
        self._counts: Counter[str] = Counter()
        self._datagrams: list[bytes] = []

    @property
    def port(self) -> int:
        """The UDP port on loopback to send to."""
        return int(self._socket.getsockname()[1])

    @property
    def url(self) -> str:
        """The endpoint as base.toml names it."""
        return f"udp:127.0.0.1:{self.port}"

    @property
    def positions(self) -> list[Position]:
        """All positions so far."""
        with self._came:
            return list(self._positions)

    @property
    def counts(self) -> Counter[str]:
        """How many of each message came; BAD_DATA: of what could not be read or verified."""
        with self._came:
            return Counter(self._counts)

    @property
    def datagrams(self) -> list[bytes]:
        """All datagrams so far."""
        with self._came:
            return list(self._datagrams)

    @property
    def missing(self) -> int:
        """How many frames were lost on the way, by their senders' own sequence numbers (MAVLink 2: bytes 4 to 6)."""
        last: dict[tuple[int, int], int] = {}
        count = 0
        for frame in self.datagrams:
            sender, number = (frame[5], frame[6]), frame[4]
            count += (number - last.get(sender, number - 1) - 1) % 256
            last[sender] = number
        return count

    def wait(self, positions: int, within_s: float) -> bool:
        """Whether so many positions have come, now or within a while."""
        with self._came:
            return self._came.wait_for(lambda: len(self._positions) >= positions, within_s)

    def close(self) -> None:
        """End it, and its socket with it."""
        super().close()
        self._socket.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                datagram = self._socket.recv(LARGEST)
            except TimeoutError:
                continue
            received_ns = time.time_ns()
            # A decoder a datagram: a damaged one must not swallow the next.
            decoder: Any = common.MAVLink(None)
            decoder.robust_parsing, decoder.signing = True, self._signing
            messages = decoder.parse_buffer(datagram) or []
            with self._came:
                self._datagrams.append(datagram)
                for message in messages:
                    self._take(message, received_ns)
                self._came.notify_all()

    def _take(self, message: Any, received_ns: int) -> None:
        kind = message.get_type()
        other = kind != "BAD_DATA" and message.get_srcSystem() == self._but
        self._counts["others" if other else kind] += 1
        if kind == "TARGET_TRACK_ECEF":
            self._positions.append(
                Position(
                    received_ns,
                    message.time_usec * 1000,
                    message.meas_age * 1_000_000,
                    tuple(message.pos),
                    message.track_id,
                    message.state,
                    message.camera_count,
                    message.epoch,
                    tuple(message.cov),
                )
            )


@cache
def _dialect() -> ModuleType:
    """The private dialect, generated and imported."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "dialect.py"
        path.write_text(generate(XML.read_text(encoding="utf-8")), encoding="utf-8")
        spec = importlib.util.spec_from_file_location("skyfix_listener_dialect", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module
        spec.loader.exec_module(module)
    return module
