"""A toy output: each target as a line of JSON in a datagram. What it takes to add a protocol is this file."""

import json
import socket
from collections.abc import Sequence
from typing import Any

import msgspec

from calib.geodesy import Origin
from calib.station.core.outgoing import OutgoingTarget
from calib.station.outputs.output import CommandHandler, OutputContext, StationStanding
from calib.station.status.status import EndpointStatus
from edge.common.health import Check, HealthLevel
from edge.common.settings import build


class JsonLinesSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Its table of the configuration."""

    port: int
    rate_hz: float = 10.0


def open_output(table: dict[str, Any], context: OutputContext) -> "JsonLines":
    return JsonLines(build(table, JsonLinesSection, where=context.where), context)


class JsonLines:
    def __init__(self, section: JsonLinesSection, context: OutputContext) -> None:
        self.rate_hz = section.rate_hz
        self._address, self._context = ("127.0.0.1", section.port), context
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sent = 0

    def targets(self, targets: Sequence[OutgoingTarget], now_ns: int, synced: bool) -> None:
        for target in targets:
            self._send({"track": target.track, "ecef_m": target.ecef_m.tolist(), "sigma_m": target.sigma_m})

    def second(self, standing: StationStanding, texts: Sequence[tuple[HealthLevel, str]], now_ns: int) -> None:
        self._send(
            {"phase": standing.phase, "fault": standing.fault, "online": sum(c.online for c in standing.cameras)}
        )

    def moved(self, origin: Origin) -> None:
        self._send({"origin": origin})

    def calibrated(self, done: bool, now_ns: int) -> None:
        self._send({"calibrated": done})

    def receive(self, now_ns: int, now_unix_ns: int, command: CommandHandler) -> None:
        pass

    def wait(self, timeout_s: float) -> None:
        pass

    def checks(self, now_ns: int) -> list[Check]:
        return [Check("lines", "ok", "sends")]

    @property
    def counters(self) -> dict[str, float]:
        return {"sent": float(self._sent)}

    @property
    def status(self) -> list[EndpointStatus]:
        url = f"udp:{self._address[0]}:{self._address[1]}"
        return [EndpointStatus(output="lines", url=url, sent=self._sent, sent_bytes=0, errors=0, last_error="")]

    def close(self) -> None:
        self._socket.close()

    def _send(self, line: dict[str, Any]) -> None:
        frame = json.dumps(line).encode()
        self._socket.sendto(frame, self._address)
        self._context.record("lines", frame)
        self._sent += 1
