"""MAVLink bytes in and out, signed where a key is given, with a verification that cannot be poisoned.

The hazards are pymavlink's. It only adds 10 microseconds a message to the signing time, and a receiver refuses a stream
more than a minute behind: a station up for longer could not be joined. It believes a frame's time before it has checked
the frame's hash: one forged frame from the year 2100 shuts out every good one after it. Here the time is refreshed
before each message, a frame is checked before anything is learnt from it, and a good one from far in the future is
refused too, because it would carry us there. And it forgets at every restart, and on every other endpoint, what it has
already obeyed: a command overheard on the radio and replayed by TCP would be obeyed twice.
"""

import hmac
import struct
from hashlib import sha256
from pathlib import Path
from typing import Final, Literal

from pymavlink.dialects.v20 import common

from calib.station.outputs.mavlink.signing_time import SIGNED_AHEAD_S
from edge.common.errors import ConfigError

SIGNING_EPOCH_S: Final = 1_420_070_400  # 2015-01-01, where MAVLink's signing time begins
TICKS_PER_S: Final = 100_000  # of signing time
WINDOW_TICKS: Final = 60 * TICKS_PER_S  # a new stream may be so far off, as every implementation has it
SIGNED_TAIL: Final = 13  # bytes: link id, 6 of time, 6 of hash
MAX_STREAMS: Final = 64  # peers remembered; forged ones never get in

# What a frame's signature is worth; all but "good" are reasons not to obey.
Signature = Literal["good", "unsigned", "forged", "replayed", "ahead", "behind", "crowded"]
Stream = tuple[int, int, int]  # link, system and component id of a sender


def ticks(unix_s: float) -> int:
    """Signing time of an instant."""
    return int((unix_s - SIGNING_EPOCH_S) * TICKS_PER_S)


def unix_of(signed: int) -> float:
    """The instant of a signing time, s; 0 for none."""
    return signed / TICKS_PER_S + SIGNING_EPOCH_S if signed else 0.0


class Streams:
    """How far each sender's signed stream has come; one for all endpoints that share a key."""

    def __init__(self, began_unix_s: float) -> None:
        """began_unix_s: what was signed before may have been obeyed before the restart."""
        self._began = ticks(began_unix_s)
        self._last: dict[Stream, int] = {}

    def begin(self, unix_s: float) -> None:
        """The clock has been set only now: what was signed before may have been obeyed before the restart."""
        self._began = ticks(unix_s)

    def judge(self, stream: Stream, time: int, now: int) -> Signature:
        """What a frame whose hash is right is worth, by its time; a good one moves its stream on. Times: ticks."""
        last = self._last.get(stream)
        if time > now + WINDOW_TICKS:
            return "ahead"
        if last is not None and time <= last:
            return "replayed"
        if last is None and time < max(self._began, now - WINDOW_TICKS):
            return "behind"
        if last is None and len(self._last) >= MAX_STREAMS:
            return "crowded"
        self._last[stream] = time
        return "good"


class Codec(common.MAVLink):  # type: ignore[misc]  # pymavlink is untyped
    """One sender and receiver: one system and component id, one sequence, one owner."""

    def __init__(
        self, system: int, component: int, key: bytes | None = None, link_id: int = 1, streams: Streams | None = None
    ) -> None:
        """streams: what was believed already; None: nothing, and on no other endpoint."""
        super().__init__(None, srcSystem=system, srcComponent=component)
        self.robust_parsing = True
        self.refused = 0
        self._streams = Streams(SIGNING_EPOCH_S) if streams is None else streams
        self._now = 0
        self._signature: Signature = "unsigned"
        if key is not None:
            self.signing.secret_key = key
            self.signing.sign_outgoing = True
            self.signing.link_id = link_id

    def encoded(self, message: common.MAVLink_message) -> bytes:
        """The message's frame, with the next sequence number."""
        frame = bytes(message.pack(self))
        self.seq: int = (self.seq + 1) % 256
        return frame

    def refresh(self, now_unix_s: float, at_least: int = 0) -> None:
        """Bring the signing time up to the clock, or to at_least, in ticks. It goes back by days or not at all.

        By how much, and when, is signing_time.py's to say; what a few frames have added is no reason.
        """
        self._now = ticks(now_unix_s)
        wanted = max(self._now, at_least)
        taken_back = self.signing.timestamp - wanted > SIGNED_AHEAD_S * TICKS_PER_S / 2
        self.signing.timestamp = wanted if taken_back else max(self.signing.timestamp, wanted)

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:
        """Whether a frame's signature is good: the hash first, then its time against its stream's and ours."""
        self._signature = self._judged(bytes(msgbuf), srcSystem, srcComponent)
        return self._signature == "good"

    def _judged(self, frame: bytes, system: int, component: int) -> Signature:
        digest = sha256(self.signing.secret_key + frame[:-6]).digest()[:6]
        if not hmac.compare_digest(digest, frame[-6:]):
            return "forged"
        link, low, high = struct.unpack("<BIH", frame[-SIGNED_TAIL:-6])
        return self._streams.judge((link, system, component), low + (high << 32), self._now)

    def decode(self, msgbuf: bytearray) -> common.MAVLink_message:
        """As pymavlink's, and what the signature is worth is kept on the message as `signature`."""
        self._signature = "unsigned"
        message = super().decode(msgbuf)
        message.signature = self._signature
        return message

    def received(self, data: bytes) -> list[common.MAVLink_message]:
        """The good messages in some bytes; bad and unknown frames are counted, never raised."""
        good = []
        for message in self.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN"):
                self.refused += 1
            else:
                good.append(message)
        return good


def read_key(path: Path) -> bytes:
    """32 bytes from a file of 64 hex digits. Raises ConfigError if it is not one or others may read it."""
    try:
        mode, text = path.stat().st_mode & 0o077, path.read_text(encoding="ascii").strip()
        key = bytes.fromhex(text)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"no signing key ({error})", where=str(path), action="write 64 hex digits: openssl rand -hex 32"
        ) from error
    if len(key) != 32 or mode:
        fault = f"{len(key)} bytes" if len(key) != 32 else "readable by others"
        raise ConfigError(f"signing key is {fault}", where=str(path), action="64 hex digits, chmod 600")
    return key
