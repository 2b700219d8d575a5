"""All MAVLink endpoints together: which port speaks through which socket."""

import logging
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from pymavlink.dialects.v20 import common

from calib.geodesy import Origin
from calib.station.config import BaseConfig
from calib.station.core.outgoing import OutgoingTarget
from calib.station.outputs.mavlink.codec import CLOCK_SET_S, Streams, read_key
from calib.station.outputs.mavlink.endpoint import Endpoint, open_endpoint
from calib.station.outputs.mavlink.messages import TrackerStatus, Voice
from calib.station.outputs.mavlink.port import MavlinkPort
from calib.station.status.status import EndpointStatus
from edge.common.errors import ConfigError
from edge.common.health import Check

log = logging.getLogger(__name__)

RECENT_NS: Final = 60 * 10**9  # how long a refused command is spoken of
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
        self._lines: list[tuple[MavlinkPort, Endpoint]] = []
        self._errors: Counter[str] = Counter()
        self._refused, self._refused_ns = 0, -RECENT_NS
        streams: dict[bytes | None, Streams] = {}
        for section in config.mavlink.endpoint:
            key = read_key(folder / section.signing_key) if section.signing_key else None
            if key is not None and time.time() < CLOCK_SET_S:
                raise ConfigError(
                    "the clock is not set, signing with it would lock this station out later",
                    where=section.url,
                    action="set the clock (chrony) and start again",
                )
            port = MavlinkPort(section, config.mavlink, voice, key, streams.setdefault(key, Streams(time.time())))
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

    def targets(self, targets: list[OutgoingTarget], now_ns: int, synced: bool) -> None:
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
    def counters(self) -> dict[str, float]:
        """Messages sent, and commands obeyed and refused by reason, over all endpoints."""
        total: Counter[str] = Counter()
        for port, _ in self._lines:
            total.update(port.counters)
        return {f"mavlink_{name}": float(count) for name, count in total.items()}

    def checks(self, now_ns: int) -> list[Check]:
        """Whether each endpoint takes what is sent, and whether somebody tries to give orders."""
        checks = [self._check(endpoint) for _, endpoint in self._lines]
        refused = sum(port.counters["commands_refused"] for port, _ in self._lines)
        if refused > self._refused:
            self._refused, self._refused_ns = refused, now_ns
        if now_ns - self._refused_ns < RECENT_NS:
            action = "sign with this station's key, list the system in commands_from, or find out who it is"
            checks.append(Check("mavlink commands", "warn", f"{refused} were refused ({self._reasons()})", action))
        return checks

    def _check(self, endpoint: Endpoint) -> Check:
        failing = endpoint.errors > self._errors[endpoint.url]
        self._errors[endpoint.url] = endpoint.errors
        if failing:
            action = "start the receiver, check the address"
            return Check(f"mavlink {endpoint.url}", "warn", endpoint.last_error, action)
        return Check(f"mavlink {endpoint.url}", "ok", "sends")

    def _reasons(self) -> str:
        names = {name: count for name, count in self.counters.items() if name.startswith("mavlink_commands_")}
        for total in ("obeyed", "refused"):
            names.pop(f"mavlink_commands_{total}")
        return ", ".join(f"{count:.0f} {name.removeprefix('mavlink_commands_')}" for name, count in names.items())

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
