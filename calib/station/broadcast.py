"""All MAVLink endpoints together: which port speaks through which socket."""

import logging
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from pymavlink.dialects.v20 import common

from calib.geodesy import Origin
from calib.station.config import BaseConfig
from calib.station.endpoint import Endpoint, open_endpoint
from calib.station.mavlink import TrackerStatus, Voice
from calib.station.mavlink_codec import CLOCK_SET_S, read_key
from calib.station.mavlink_port import Port
from calib.station.outgoing import Outgoing
from calib.station.status import EndpointStatus
from edge.errors import ConfigError

log = logging.getLogger(__name__)

SEVERITIES: Final = {
    "ok": common.MAV_SEVERITY_NOTICE,
    "warn": common.MAV_SEVERITY_WARNING,
    "fail": common.MAV_SEVERITY_ERROR,
}


class Broadcast:
    """Sends to all endpoints. Frames sent are handed to `sent` too, for the recording."""

    def __init__(
        self, config: BaseConfig, folder: Path, epoch: int, signing_ticks: int, sent: Callable[[str, bytes], None]
    ) -> None:
        """Raises ConfigError if an endpoint cannot be opened, or cannot be signed for."""
        self._config, self._epoch, self._sent = config, epoch, sent
        voice = self._voice(config.site.origin or (0.0, 0.0, 0.0))
        self._lines: list[tuple[Port, Endpoint]] = []
        for section in config.mavlink.endpoint:
            key = read_key(folder / section.signing_key) if section.signing_key else None
            if key is not None and time.time() < CLOCK_SET_S:
                raise ConfigError(
                    "the clock is not set, signing with it would lock this station out later",
                    where=section.url,
                    action="set the clock (chrony) and start again",
                )
            port = Port(section, config.mavlink, voice, key)
            port.refresh(time.time(), signing_ticks)
            self._lines.append((port, open_endpoint(section.url)))

    def _voice(self, origin: Origin) -> Voice:
        return Voice(origin, self._epoch, self._config.mavlink.simulated, self._config.site.undulation_m)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for _, endpoint in self._lines:
            endpoint.close()

    def move_to(self, origin: Origin) -> None:
        """A network about another origin is in force."""
        for port, _ in self._lines:
            port.move_to(self._voice(origin))

    def targets(self, targets: list[Outgoing], now_ns: int, synced: bool) -> None:
        """Send targets that moved, coast or are lost; and the farewells that are due."""
        for port, endpoint in self._lines:
            self._send(endpoint, port.targets(targets, now_ns, synced), now_ns)

    def second(self, status: TrackerStatus, texts: list[tuple[str, str]], now_ns: int) -> int:
        """Send what is sent every second, and words; returns the signing time to be stored."""
        newest = 0
        for port, endpoint in self._lines:
            newest = max(newest, port.refresh(time.time()))
            frames = port.second(status)
            for level, text in texts:
                frames += port.text(SEVERITIES[level], text)
            self._send(endpoint, frames, now_ns)
        return newest

    def receive(self, now_ns: int, now_unix_ns: int, wish: Callable[[str], bool]) -> None:
        """Hear and answer."""
        for port, endpoint in self._lines:
            for _, data in endpoint.receive(now_ns):
                self._send(endpoint, port.receive(data, now_unix_ns, wish), now_ns)

    def calibrated(self, done: bool, now_ns: int) -> None:
        """Tell whoever asked for a calibration how it ended."""
        for port, endpoint in self._lines:
            self._send(endpoint, port.finished(done), now_ns)

    def _send(self, endpoint: Endpoint, frames: list[bytes], now_ns: int) -> None:
        endpoint.send(frames, now_ns)
        for frame in frames:
            self._sent(endpoint.url, frame)

    @property
    def status(self) -> list[EndpointStatus]:
        """How each endpoint is."""
        return [
            EndpointStatus(
                url=endpoint.url,
                sent=port.counters["sent"],
                sent_bytes=endpoint.sent_bytes,
                errors=endpoint.errors,
                last_error=endpoint.last_error,
            )
            for port, endpoint in self._lines
        ]
