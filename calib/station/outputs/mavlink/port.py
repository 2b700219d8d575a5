"""One receiver of MAVLink: what it gets and when, and what it may ask. Pure: bytes in, bytes out, the time handed in.

The hazards: a radio that drowns in full-rate tracks, an aircraft that stays on the map because its end was never sent,
and a command obeyed that nobody was entitled to give. So tracks are limited in rate per target, LOST is sent three
times and then nothing, and commands count only when signed, or from a system that the configuration lists; but every
command addressed to us is answered, because senders repeat what is not. Addressed to all components of the system that
the station shares with a vehicle, only its own commands are: whoever waits for the autopilot's answer would take ours.
And a question is no order: QGroundControl asks whatever beats under its vehicle's system id, a dozen times, whether it
is a camera or a gimbal (READ in its camera manager and gimbal controller), and that must not look like an attack.
"""

import math
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import common

from calib.station.config import EndpointSection, MavlinkSection
from calib.station.core.outgoing import OutgoingTarget
from calib.station.outputs.mavlink import dialect, messages
from calib.station.outputs.mavlink.codec import Codec, Streams
from calib.station.outputs.mavlink.identity import Clashes
from calib.station.outputs.mavlink.messages import MavlinkContext, TrackerStatus
from calib.station.outputs.mavlink.timesync import asks_us, timesync_answer
from calib.station.outputs.output import CommandHandler
from calib.tracking.estimates import TargetState
from edge.common.units import NS

LOST_REPEATS: Final = 3  # UDP loses one in a hundred, hardly three in a row
LOST_SPACING_NS: Final = 200_000_000
TEXTS_A_SECOND: Final = 5  # STATUSTEXT: an operator reads no more, a radio carries no more
MAX_INTERVAL_US: Final = 60_000_000
MOST_PEERS: Final = 64  # parsers kept: clients of one endpoint at a time
OWN_COMMANDS: Final = frozenset({dialect.MAV_CMD_SKYFIX_CALIBRATE})
ONLY_ASKING: Final = frozenset(  # commands that only want to be told something
    number
    for number, entry in common.enums["MAV_CMD"].items()
    if entry.name.startswith(("MAV_CMD_REQUEST_", "MAV_CMD_GET_"))
)


@dataclass
class _Paced:
    """When each target was last sent, per message; and LOST messages still owed."""

    default_ns: int
    interval_ns: int = field(init=False)
    last_ns: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.interval_ns = self.default_ns

    def due(self, track: int, now_ns: int) -> bool:
        """Whether it is this target's turn; if so, its turn is over."""
        # A tenth early is not early: frames come at their own rate, and 30.1 Hz must not become 15.
        if now_ns - self.last_ns.get(track, -(2**62)) < self.interval_ns * 9 // 10:
            return False
        self.last_ns[track] = now_ns
        return True


@dataclass
class _LostNotice:
    target: OutgoingTarget
    left: int
    next_ns: int


class MavlinkPort:
    """What one endpoint sends and answers."""

    def __init__(
        self,
        endpoint: EndpointSection,
        options: MavlinkSection,
        context: MavlinkContext,
        key: bytes | None,
        streams: Streams | None = None,
        *,
        clashes: Clashes | None = None,
    ) -> None:
        """key: signs and verifies; None: neither. streams: what was received under this key on any endpoint.

        clashes: of all endpoints.
        """
        self._endpoint, self._context = endpoint, context
        profile = endpoint.profile
        own = context.identity
        self._gcs = Codec(options.system_id, own.component_gcs, key, endpoint.link_id) if "gcs" in profile else None
        self._ecef = Codec(options.system_id, own.component_ecef, key, endpoint.link_id) if "ecef" in profile else None
        self._new_listener: Callable[[], Codec] = lambda: Codec(
            options.system_id, own.component_gcs, key, endpoint.link_id, streams
        )
        self._listeners: dict[int, Codec] = {}  # one a peer: a frame may come in pieces, between those of others
        self._clock = (time.time(), 0)
        self._clashes = clashes or Clashes(options.system_id, own)
        self._adsb = _Paced(round(NS / options.adsb_rate_hz))
        self._tracks = _Paced(round(NS / endpoint.rate_hz))
        self._notices: list[_LostNotice] = []
        self._text_budget, self._texts = TEXTS_A_SECOND, 0
        self._signed = key is not None
        self._running: common.MAVLink_command_long_message | None = None
        self.counters = Counter(sent=0, unsendable=0, questions=0, commands_obeyed=0, commands_refused=0)

    @property
    def _codecs(self) -> list[Codec]:
        return [codec for codec in (self._gcs, self._ecef) if codec is not None]

    def move_to(self, context: MavlinkContext) -> None:
        """Send about another origin."""
        self._context = context

    def refresh(self, now_unix_s: float, stored_ticks: int = 0) -> int:
        """Bring signing times up to the clock; returns the newest, in ticks, to be stored."""
        self._clock = (now_unix_s, stored_ticks)
        for codec in (*self._codecs, *self._listeners.values()):
            codec.refresh(now_unix_s, stored_ticks)
        return max(int(codec.signing.timestamp) for codec in self._codecs)

    # Out

    def targets(self, targets: Iterable[OutgoingTarget], now_ns: int, synced: bool) -> list[bytes]:
        """Frames for targets that moved or coast, and first notices of those that are lost."""
        frames: list[bytes] = []
        for target in targets:
            if target.state is TargetState.LOST:
                self._notices.append(_LostNotice(target, LOST_REPEATS, now_ns))
                self._adsb.last_ns.pop(target.track, None)
                self._tracks.last_ns.pop(target.track, None)
                continue
            if self._ecef is not None and self._tracks.due(target.track, now_ns):
                frames += self._frame(self._ecef, messages.target_track_ecef, target, self._context, synced)
            if self._gcs is not None and self._adsb.due(target.track, now_ns):
                frames += self._frame(self._gcs, messages.adsb_vehicle, target, self._context)
        return frames + self._repeat_lost(now_ns, synced)

    def _repeat_lost(self, now_ns: int, synced: bool) -> list[bytes]:
        frames: list[bytes] = []
        for notice in self._notices:
            if self._ecef is not None and now_ns >= notice.next_ns:
                frames += self._frame(self._ecef, messages.target_track_ecef, notice.target, self._context, synced)
                notice.left, notice.next_ns = notice.left - 1, now_ns + LOST_SPACING_NS
        self._notices = [f for f in self._notices if f.left > 0 and self._ecef is not None]
        return frames

    def second(self, status: TrackerStatus, *, faulted: bool, now_unix_ns: int = 0) -> list[bytes]:
        """The frames of every second: heartbeats, times, the tracker's status. No heartbeat when faulted.

        now_unix_ns: UTC by this machine's clock; 0: not to be told.
        """
        self._text_budget = TEXTS_A_SECOND
        frames: list[bytes] = []
        for codec in self._codecs:
            frames += [] if faulted else self._frame(codec, messages.heartbeat, status)
            frames += self._frame(codec, messages.system_time, status, now_unix_ns)
        if self._ecef is not None:
            frames += self._frame(self._ecef, messages.tracker_status, status, self._context)
        return frames

    def text(self, severity: int, text: str) -> list[bytes]:
        """A state change in words, if there is room for it this second."""
        codec = self._gcs or self._ecef
        if codec is None or self._text_budget <= 0:
            return []
        self._text_budget -= 1
        self._texts += 1
        return [codec.encoded(message) for message in messages.status_texts(severity, text, self._texts)]

    def _frame(self, codec: Codec, make: Callable[..., common.MAVLink_message], *parts: object) -> list[bytes]:
        """The frame, or nothing if a number does not fit its field: a bad target must not stop the others."""
        try:
            frame = codec.encoded(make(*parts))
        except (ValueError, OverflowError, struct.error):
            self.counters["unsendable"] += 1
            return []
        self.counters["sent"] += 1
        return [frame]

    # In

    def receive(self, data: bytes, now_unix_ns: int, command: CommandHandler, peer: int = 0) -> list[bytes]:
        """Answers to what came from a peer. command: called for a command that is obeyed; whether it can be done."""
        replies: list[bytes] = []
        for message in self._heard(peer).received(data):
            kind = message.get_type()
            self._clashes.hear(message)
            if kind == "TIMESYNC":
                replies += [
                    timesync_answer(codec, message, now_unix_ns)
                    for codec in self._codecs[:1]
                    if asks_us(codec, message)
                ]
            elif kind in {"COMMAND_LONG", "COMMAND_INT"}:
                replies += self._answer(message, command)
        return replies

    def _heard(self, peer: int) -> Codec:
        if peer not in self._listeners:
            if len(self._listeners) >= MOST_PEERS:
                del self._listeners[next(iter(self._listeners))]
            listener = self._listeners[peer] = self._new_listener()
            listener.signing.allow_unsigned_callback = lambda *_: True  # obeyed or not is decided per command
            listener.refresh(*self._clock)
        return self._listeners[peer]

    def _answer(self, message: common.MAVLink_command_long_message, command: CommandHandler) -> list[bytes]:
        codec = self._addressed(message)
        if codec is None or (message.target_component == 0 and message.command not in OWN_COMMANDS):
            return []
        if message.command in ONLY_ASKING and message.signature in {"good", "unsigned"}:
            self.counters["questions"] += 1
            result, extra = self._tell(codec, message)
            return [self._acknowledge(codec, message, result), *extra]
        extra = []
        if not self._entitled(message):
            result = common.MAV_RESULT_DENIED
            self.counters[f"commands_{message.signature if self._signed else 'unlisted'}"] += 1
        else:
            result, extra = self._obey(codec, message, command)
            if result in REFUSALS:
                self.counters[f"commands_{REFUSALS[result]}"] += 1
        obeyed = result in {common.MAV_RESULT_ACCEPTED, common.MAV_RESULT_IN_PROGRESS}
        self.counters["commands_obeyed" if obeyed else "commands_refused"] += 1
        return [self._acknowledge(codec, message, result), *extra]

    def _addressed(self, message: common.MAVLink_command_long_message) -> Codec | None:
        for codec in self._codecs:
            if message.target_system == codec.srcSystem and message.target_component in {0, codec.srcComponent}:
                return codec
        return None

    def _entitled(self, message: common.MAVLink_command_long_message) -> bool:
        """Signed with our key, or from a system the configuration lists where no key is set."""
        if self._signed:
            return bool(message.signature == "good")
        return message.get_srcSystem() in self._endpoint.commands_from

    def _obey(
        self, codec: Codec, message: common.MAVLink_command_long_message, command: CommandHandler
    ) -> tuple[int, list[bytes]]:
        if message.command == dialect.MAV_CMD_SKYFIX_CALIBRATE:
            if self._running is not None:
                return common.MAV_RESULT_TEMPORARILY_REJECTED, []
            if not command("calibrate"):
                return common.MAV_RESULT_TEMPORARILY_REJECTED, []
            self._running = message
            return common.MAV_RESULT_IN_PROGRESS, []
        if message.command == common.MAV_CMD_SET_MESSAGE_INTERVAL:
            return self._set_interval(_whole(message.param1), float(message.param2)), []
        return common.MAV_RESULT_UNSUPPORTED, []

    def _tell(self, codec: Codec, message: common.MAVLink_command_long_message) -> tuple[int, list[bytes]]:
        """The answer to a question: the version, to whoever may give orders; of all else there is nothing to tell."""
        version = (common.MAV_CMD_REQUEST_MESSAGE, common.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        if (message.command, _whole(message.param1)) != version:
            return common.MAV_RESULT_UNSUPPORTED, []
        if not self._entitled(message):
            return common.MAV_RESULT_DENIED, []
        return common.MAV_RESULT_ACCEPTED, [codec.encoded(_version())]

    def _set_interval(self, message_id: int, interval_us: float) -> int:
        paced = {246: self._adsb, 45000: self._tracks}.get(message_id)
        if paced is None:
            return int(common.MAV_RESULT_UNSUPPORTED)
        if interval_us == 0:  # as MAVLink has it: the default
            paced.interval_ns = paced.default_ns
            return int(common.MAV_RESULT_ACCEPTED)
        # 5 ms: 200 Hz. And never -1, which would turn it off: others on the line would take the sky for empty.
        if not 5_000 <= interval_us <= MAX_INTERVAL_US:
            return int(common.MAV_RESULT_DENIED)
        paced.interval_ns = round(interval_us * 1000)
        return int(common.MAV_RESULT_ACCEPTED)

    def finished(self, done: bool) -> list[bytes]:
        """The final acknowledgement of a calibration that was asked for."""
        if self._running is None:
            return []
        message, self._running = self._running, None
        result = common.MAV_RESULT_ACCEPTED if done else common.MAV_RESULT_FAILED
        codec = self._addressed(message)
        return [] if codec is None else [self._acknowledge(codec, message, result)]

    def _acknowledge(self, codec: Codec, message: common.MAVLink_command_long_message, result: int) -> bytes:
        return codec.encoded(
            common.MAVLink_command_ack_message(
                command=message.command,
                result=result,
                target_system=message.get_srcSystem(),
                target_component=message.get_srcComponent(),
            )
        )


REFUSALS: Final = {  # why a command of somebody who is entitled to it is not obeyed
    common.MAV_RESULT_UNSUPPORTED: "unsupported",
    common.MAV_RESULT_TEMPORARILY_REJECTED: "too early",
    common.MAV_RESULT_DENIED: "out of range",
}


def _whole(number: float) -> int:
    """A parameter that stands for a whole number; -1, which nothing is called, where it is none."""
    return int(number) if math.isfinite(number) else -1


def _version() -> common.MAVLink_autopilot_version_message:
    capabilities = common.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    return common.MAVLink_autopilot_version_message(capabilities, 0, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)
