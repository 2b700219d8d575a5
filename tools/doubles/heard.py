"""What a base has recorded: the boxes' messages, live and late, and the positions it sent."""

from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from pymavlink.dialects.v20 import common

import calib.station.outputs.mavlink.messages  # noqa: F401 -- registers the dialect with pymavlink's parser
from calib.station.outputs.mavlink import dialect
from edge.messages import camera_of_key
from tools.doubles.tail import Tail

NS: Final = 1e-9


class Row(NamedTuple):
    """One Tracks message as the base recorded it. late: by the backlog."""

    camera: str
    epoch: int
    seq: int
    t_unix_ns: int
    t_arrival_ns: int
    late: bool


class Sent(NamedTuple):
    """One confirmed position as it went out by MAVLink. covariance: upper triangle of the 6 x 6, ECEF."""

    t_arrival_ns: int
    t_unix_ns: int
    track: int
    ecef_m: list[float]
    covariance: list[float]


class _Numbers(msgspec.Struct):
    epoch: int
    seq: int
    t_unix_ns: int


class _Frame(msgspec.Struct):
    frame: str


class Heard:
    """The recordings in a folder, read as they grow."""

    def __init__(self, folder: Path) -> None:
        self._tail = Tail(folder)
        self._numbers = msgspec.json.Decoder(_Numbers)
        self._frames = msgspec.json.Decoder(_Frame)
        self._parser = common.MAVLink(None)
        self.rows: list[Row] = []
        self.keys: set[tuple[str, int, int]] = set()  # camera, epoch, seq
        self.sent: list[Sent] = []

    def look(self) -> list[Row]:
        """Take in what is new; every Tracks message so far."""
        for item in self._tail.new():
            topic, camera = item.key.rpartition("/")[2], camera_of_key(item.key)
            if camera is not None and topic in ("tracks", "backlog"):
                told = self._numbers.decode(item.payload)
                late = topic == "backlog"
                self.rows.append(Row(camera, told.epoch, told.seq, told.t_unix_ns, item.t_arrival_ns, late))
                self.keys.add((camera, told.epoch, told.seq))
            elif item.key.endswith("/station/mavlink"):
                self._take_frame(item.t_arrival_ns, bytes.fromhex(self._frames.decode(item.payload).frame))
        return self.rows

    def _take_frame(self, t_arrival_ns: int, frame: bytes) -> None:
        for said in self._parser.parse_buffer(frame) or ():
            if said.get_type() == "TARGET_TRACK_ECEF" and said.state == dialect.TRACK_STATE_CONFIRMED:
                t_unix_ns = said.time_usec * 1000
                self.sent.append(Sent(t_arrival_ns, t_unix_ns, said.track_id, list(said.pos), list(said.cov)))

    def live_since(self, t_unix_ns: int) -> set[str]:
        """The cameras of which something live came that was made after an instant."""
        found = set()
        for row in reversed(self.look()):
            if row.t_arrival_ns < t_unix_ns:
                break
            if not row.late and row.t_unix_ns > t_unix_ns:
                found.add(row.camera)
        return found

    def positions_since(self, t_unix_ns: int) -> bool:
        """Whether a confirmed target was sent of an instant after this one."""
        self.look()
        return any(sent.t_arrival_ns > t_unix_ns < sent.t_unix_ns for sent in self.sent[-10:])


def latency_s(rows: list[Row], begin_unix_s: float, end_unix_s: float) -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Latencies of the live messages that were made in a stretch of time; base and boxes share this machine's clock."""
    chosen = [row for row in rows if not row.late and begin_unix_s / NS <= row.t_unix_ns < end_unix_s / NS]
    return np.array([(row.t_arrival_ns - row.t_unix_ns) * NS for row in chosen])


def live_again_after(rows: list[Row], camera: str, since_unix_s: float) -> float:
    """How long after an instant the first live message came that was made after it, in seconds."""
    first = [r.t_arrival_ns for r in rows if r.camera == camera and not r.late and r.t_unix_ns >= since_unix_s / NS]
    return min(first) * NS - since_unix_s if first else float("inf")
