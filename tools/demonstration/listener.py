"""An independent receiver of the station's MAVLink: plain pymavlink on a UDP socket, nothing of Skyfix in it.

The private messages are decoded with code generated here and now from the dialect's XML, not with the module that the
station encodes them with: a message that only its own author can read would not pass.
"""

import importlib.util
import socket
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Final, NamedTuple, Self

from pymavlink.dialects.v20 import common

from tools.make_dialect import XML, generate

POLL_S: Final = 0.1  # s between looks at whether to stop
LARGEST: Final = 65536  # bytes of a UDP datagram


class Position(NamedTuple):
    """One TARGET_TRACK_ECEF as it arrived. received_ns: UTC; time_ns: of validity; age_ns: of the last measurement."""

    received_ns: int
    time_ns: int
    age_ns: int
    ecef_m: tuple[float, float, float]
    track: int
    state: int
    cameras: int


class Listener:
    """Receives in a thread of its own. Use as a context manager."""

    def __init__(self, folder: Path) -> None:
        """folder: where the generated dialect is put."""
        # One map for both: the standard messages, and the private ones as the XML defines them.
        common.mavlink_map.update(_dialect(folder / "dialect.py").mavlink_map)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(POLL_S)
        self._lock = threading.Lock()
        self._positions: list[Position] = []
        self._messages: Counter[str] = Counter()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mavlink-listener")

    @property
    def port(self) -> int:
        """The UDP port on loopback to send to."""
        return int(self._socket.getsockname()[1])

    @property
    def positions(self) -> list[Position]:
        """All positions so far."""
        with self._lock:
            return list(self._positions)

    @property
    def messages(self) -> dict[str, int]:
        """How many of each message came."""
        with self._lock:
            return dict(self._messages)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
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
            decoder.robust_parsing = True
            for message in decoder.parse_buffer(datagram) or []:
                self._take(message, received_ns)

    def _take(self, message: Any, received_ns: int) -> None:
        kind = message.get_type()
        with self._lock:
            self._messages[kind] += 1
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
                    )
                )


def _dialect(path: Path) -> ModuleType:
    """The private dialect, generated and imported."""
    path.write_text(generate(XML.read_text(encoding="utf-8")), encoding="utf-8")
    spec = importlib.util.spec_from_file_location("skyfix_demo_dialect", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
