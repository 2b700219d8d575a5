"""MAVLink as an output: all its endpoints together, and which port speaks through which socket."""

import logging
import select
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import common

from calib.geodesy import Origin
from calib.station.config import EndpointSection, MavlinkSection
from calib.station.core.outgoing import OutgoingTarget
from calib.station.outputs.mavlink.codec import Streams, read_key, ticks, unix_of
from calib.station.outputs.mavlink.endpoint import Endpoint, open_endpoint
from calib.station.outputs.mavlink.identity import Clashes, identity_of
from calib.station.outputs.mavlink.messages import MavlinkContext
from calib.station.outputs.mavlink.port import MavlinkPort
from calib.station.outputs.mavlink.signing_time import CLOCK_SET_S, SignedAt, SigningTime
from calib.station.outputs.mavlink.tracker_status import tracker_status
from calib.station.outputs.output import CommandHandler, OutputContext, StationStanding
from calib.station.status.status import EndpointStatus
from edge.clock.kernel import read_kernel
from edge.common.errors import ConfigError
from edge.common.health import Check, HealthLevel
from edge.common.settings import build

log = logging.getLogger(__name__)

NEVER_BLOCKS: Final = True  # see endpoint.py
REFUSAL_RECENT_NS: Final = 60 * 10**9  # how long a refused command is spoken of
SEVERITIES: Final[dict[HealthLevel, int]] = {
    "ok": common.MAV_SEVERITY_NOTICE,
    "warn": common.MAV_SEVERITY_WARNING,
    "fail": common.MAV_SEVERITY_ERROR,
}


def open_output(table: dict[str, Any], context: OutputContext) -> "MavlinkOutput":
    """All endpoints of [mavlink]. Raises ConfigError if one cannot be opened, or cannot be signed for."""
    return MavlinkOutput(build(table, MavlinkSection, where=context.where), context)


class MavlinkOutput:
    """Sends to all endpoints."""

    def __init__(self, options: MavlinkSection, context: OutputContext) -> None:
        """Raises ConfigError as `open_output` does."""
        self._options, self._context = options, context
        self._lines: list[tuple[MavlinkPort, Endpoint, EndpointSection]] = []
        self._errors: Counter[str] = Counter()
        self._refused, self._refused_ns = 0, -REFUSAL_RECENT_NS
        self._streams: dict[bytes | None, Streams] = {}
        self._identity = identity_of(options, context.site.name, context.folder)
        self._clashes = Clashes(options.system_id, self._identity)
        self._signing = SigningTime(unix_of(context.signing_ticks))
        self._signed_at: SignedAt | None = None
        try:
            for section in options.endpoint:
                self._lines.append((self._port(section), open_endpoint(section.url), section))
        except ConfigError:
            self.close()
            raise
        self._refresh()

    def _port(self, section: EndpointSection) -> MavlinkPort:
        key = read_key(self._context.folder / section.signing_key) if section.signing_key else None
        streams = self._streams.setdefault(key, Streams(time.time()))
        mavlink = self._mavlink_context(self._context.site.origin or (0.0, 0.0, 0.0))
        port = MavlinkPort(section, self._options, mavlink, key, streams, clashes=self._clashes)
        port.refresh(time.time(), self._context.signing_ticks)
        return port

    def _refresh(self) -> None:
        """Bring all signing times up to the clock; while it is not set, what has a key says and hears nothing."""
        unix_s = time.time()
        disciplined = read_kernel().bound_s is not None
        times = self._signing.at(unix_s, time.monotonic(), disciplined=disciplined)
        if times is not None and self._signed_at is None:
            for streams in self._streams.values():
                streams.begin(times.clock_unix_s)
        self._signed_at = times
        if times is None:
            return
        signed = ticks(times.signed_unix_s)
        for port, _, _ in self._lines:
            port.refresh(times.clock_unix_s, signed)
        self._context.keep_signing_ticks(signed)

    @property
    def _speaking(self) -> list[tuple[MavlinkPort, Endpoint, EndpointSection]]:
        """All that can be spoken through: without a clock nothing is signed, nor is a signature worth anything."""
        return [line for line in self._lines if self._signed_at is not None or not line[2].signing_key]

    def _mavlink_context(self, origin: Origin) -> MavlinkContext:
        undulation_m = self._context.site.undulation_m
        return MavlinkContext(origin, self._context.epoch, self._identity, self._options.simulated, undulation_m)

    @property
    def rate_hz(self) -> float:
        """The fastest of its endpoints' rates."""
        return max(section.rate_hz for section in self._options.endpoint)

    def close(self) -> None:
        """Close all endpoints."""
        for _, endpoint, _ in self._lines:
            endpoint.close()

    def moved(self, origin: Origin) -> None:
        """Send about another origin from now on."""
        for port, _, _ in self._lines:
            port.move_to(self._mavlink_context(origin))

    def targets(self, targets: Sequence[OutgoingTarget], now_ns: int, synced: bool) -> None:
        """To each endpoint what its profile and rates ask for, and what is due by time."""
        for port, endpoint, _ in self._speaking:
            self._send(endpoint, port.targets(targets, now_ns, synced), now_ns)

    def second(self, standing: StationStanding, texts: Sequence[tuple[HealthLevel, str]], now_ns: int) -> None:
        """Heartbeats (none from a station at fault), times, the tracker's status, words; signing times are kept."""
        self._refresh()
        status = tracker_status(standing)
        for port, endpoint, _ in self._speaking:
            frames = port.second(status, faulted=bool(standing.fault), now_unix_ns=self._told_unix_ns())
            for level, text in texts:
                frames += port.text(SEVERITIES[level], text)
            self._send(endpoint, frames, now_ns)

    def receive(self, now_ns: int, now_unix_ns: int, command: CommandHandler) -> None:
        """Answer what came, each peer where it came from; what comes to one that waits for the clock is let go."""
        speaking = [endpoint for _, endpoint, _ in self._speaking]
        for port, endpoint, _ in self._lines:
            for peer, data in endpoint.receive(now_ns):
                if endpoint in speaking:
                    self._send(endpoint, port.receive(data, now_unix_ns, command, peer), now_ns)

    def wait(self, timeout_s: float) -> None:
        """Until one of its sockets or lines has something to read, an error that the network reports among it."""
        poll = select.poll()
        for _, endpoint, _ in self._lines:
            for source in endpoint.sources:
                poll.register(source, select.POLLIN)
        poll.poll(timeout_s * 1e3)

    def calibrated(self, done: bool, now_ns: int) -> None:
        """Tell whoever asked for a calibration how it ended."""
        for port, endpoint, _ in self._speaking:
            self._send(endpoint, port.finished(done), now_ns)

    def _told_unix_ns(self) -> int:
        """UTC for others to set themselves by: this machine's, never a recording's; 0 where nobody should."""
        return 0 if self._options.simulated or time.time() < CLOCK_SET_S else time.time_ns()

    def _send(self, endpoint: Endpoint, frames: list[bytes], now_ns: int) -> None:
        endpoint.send(frames, now_ns)
        self._clashes.sent(frames)
        for frame in frames:
            self._context.record(endpoint.url, frame)

    @property
    def counters(self) -> dict[str, float]:
        """Messages sent, and commands obeyed and refused by reason, over all endpoints."""
        total: Counter[str] = Counter()
        for port, _, _ in self._lines:
            total.update(port.counters)
        return {name: float(count) for name, count in total.items()}

    def checks(self, now_ns: int) -> list[Check]:
        """Whether each endpoint takes what is sent, and whether somebody tries to give orders."""
        checks = [self._check(endpoint) for _, endpoint, _ in self._lines]
        refused = sum(port.counters["commands_refused"] for port, _, _ in self._lines)
        if refused > self._refused:
            self._refused, self._refused_ns = refused, now_ns
        if now_ns - self._refused_ns < REFUSAL_RECENT_NS:
            action = "sign with this station's key, list the system in commands_from, or find out who it is"
            checks.append(Check("mavlink commands", "warn", f"{refused} were refused ({self._reasons()})", action))
        return [*checks, self._clashes.check(), *self._signing_checks()]

    def _signing_checks(self) -> list[Check]:
        if self._signed_at is None and any(section.signing_key for _, _, section in self._lines):
            reason = "the clock is not set: what is signed is not sent, and no signed command obeyed"
            return [Check("mavlink signing", "warn", reason, "set the clock (chrony): it goes on by itself then")]
        if self._signing.taken_back:
            reason = "frames were signed with a time far ahead of the clock, and are no longer"
            action = "start again those receivers that refuse this station's frames"
            return [Check("mavlink signing", "warn", reason, action)]
        return []

    def _check(self, endpoint: Endpoint) -> Check:
        failing = endpoint.errors > self._errors[endpoint.url]
        self._errors[endpoint.url] = endpoint.errors
        if failing:
            action = (
                "check the address and the device" if endpoint.hopeless else "start the receiver, check the address"
            )
            level: HealthLevel = "fail" if endpoint.hopeless else "warn"
            return Check(f"mavlink {endpoint.url}", level, endpoint.last_error, action)
        return Check(f"mavlink {endpoint.url}", "ok", "sends")

    def _reasons(self) -> str:
        names = {name: count for name, count in self.counters.items() if name.startswith("commands_")}
        for total in ("obeyed", "refused"):
            names.pop(f"commands_{total}")
        return ", ".join(f"{count:.0f} {name.removeprefix('commands_')}" for name, count in names.items())

    @property
    def status(self) -> list[EndpointStatus]:
        """How each endpoint is."""
        return [
            EndpointStatus(
                output="mavlink",
                url=endpoint.url,
                content="+".join(section.profile),
                sent=port.counters["sent"],
                sent_bytes=endpoint.sent_bytes,
                errors=endpoint.errors,
                last_error=endpoint.last_error,
            )
            for port, endpoint, section in self._lines
        ]
