"""Recordings: which there are, and how it looked at an instant of one.

The hazard is a browser that asks for the middle of two gigabytes. A recording is read once into an index of where each
tenth of a second's targets lie, by a thread, and no more than a few are kept.
"""

import logging
from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec

from calib.station.archive import recording
from calib.station.page.live import corners, target_rows
from edge.messages import NetworkMessage, Targets

log = logging.getLogger(__name__)

STEP_NS: Final = 100_000_000
LONGEST_STEPS: Final = 864_000  # a day


@dataclass
class Past:
    """A recording, thinned to ten looks a second. times_ns: of arrival, rising; targets: the messages then."""

    times_ns: list[int] = field(default_factory=list)
    targets: list[bytes] = field(default_factory=list)
    network_ns: list[int] = field(default_factory=list)
    networks: list[bytes] = field(default_factory=list)
    first_ns: int = 0
    last_ns: int = 0

    @classmethod
    def read(cls, file: Path) -> "Past":
        """Raises RecordingError if it is none."""
        past = cls()
        for message in recording.read(file):
            past.first_ns = past.first_ns or message.t_arrival_ns
            past.last_ns = max(past.last_ns, message.t_arrival_ns)
            if message.key.endswith("/station/targets"):
                past._take_targets(message.t_arrival_ns, message.payload)
            elif message.key.endswith("/station/network") and past.networks[-1:] != [message.payload]:
                past.network_ns.append(message.t_arrival_ns)
                past.networks.append(message.payload)
        return past

    def _take_targets(self, t_ns: int, payload: bytes) -> None:
        due = not self.times_ns or t_ns - self.times_ns[-1] >= STEP_NS
        if due and len(self.times_ns) < LONGEST_STEPS:
            self.times_ns.append(t_ns)
            self.targets.append(payload)

    @property
    def seconds(self) -> float:
        """How long it is."""
        return (self.last_ns - self.first_ns) * 1e-9

    def at(self, seconds: float) -> dict[str, Any]:
        """How it looked so many seconds after the start: what a browser draws. Raises MessageError if it is damaged."""
        t_ns = self.first_ns + round(seconds * 1e9)
        network = self._network(t_ns)
        index = bisect_right(self.times_ns, t_ns) - 1
        rows: list[dict[str, Any]] = []
        if network is not None and network.origin is not None and index >= 0 and t_ns - self.times_ns[index] < 10**9:
            rows = target_rows(msgspec.json.decode(self.targets[index], type=Targets), network.origin)
        return {"t_unix_ns": t_ns, "targets": rows, "cameras": _cameras(network)}

    def _network(self, t_ns: int) -> NetworkMessage | None:
        index = bisect_right(self.network_ns, t_ns) - 1
        return msgspec.json.decode(self.networks[index], type=NetworkMessage) if index >= 0 else None


def _cameras(network: NetworkMessage | None) -> list[dict[str, Any]]:
    if network is None:
        return []
    return [
        {"id": camera.id, "level": "ok", "at": camera.centre_enu, "reason": "", "corners": corners(camera)}
        for camera in network.cameras
    ]


def listing(folder: Path) -> list[tuple[str, int]]:
    """Names and sizes (bytes) of the recordings in a folder, newest first."""
    files = [file for file in folder.glob("*.mcap") if file.is_file()] if folder.is_dir() else []
    return [(file.name, file.stat().st_size) for file in sorted(files, key=lambda f: f.stat().st_mtime, reverse=True)]


def named(folder: Path, name: str) -> Path | None:
    """The recording of that name, or None. A name is looked up among those there are, never joined to a path."""
    return next((folder / own for own, _ in listing(folder) if own == name), None)
