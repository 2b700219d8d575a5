"""MAVLink bytes in and out, signed where a key is given, with a verification that cannot be poisoned.

The hazards are pymavlink's. It only adds 10 microseconds a message to the signing time, and a receiver refuses a stream
more than a minute behind: a station up for longer could not be joined. It believes a frame's time before it has checked
the frame's hash: one forged frame from the year 2100 shuts out every good one after it. Here the time is refreshed
before each message, a frame is checked before anything is learnt from it, and a good one from far in the future is
refused too, because it would carry us there.
"""

import hmac
import struct
from hashlib import sha256
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import common

from edge.errors import ConfigError

SIGNING_EPOCH_S: Final = 1_420_070_400  # 2015-01-01, where MAVLink's signing time begins
TICKS_PER_S: Final = 100_000  # of signing time
WINDOW_TICKS: Final = 60 * TICKS_PER_S  # a new stream may be so far off, as every implementation has it
CLOCK_SET_S: Final = 1_600_000_000  # 2020: an earlier clock was never set, and signing with it locks us out later
SIGNED_TAIL: Final = 13  # bytes: link id, 6 of time, 6 of hash
MAX_STREAMS: Final = 64  # peers remembered; forged ones never get in


class Codec(common.MAVLink):  # type: ignore[misc]  # pymavlink is untyped
    """One sender and receiver: one system and component id, one sequence, one owner."""

    def __init__(self, system: int, component: int, key: bytes | None = None, link_id: int = 1) -> None:
        super().__init__(None, srcSystem=system, srcComponent=component)
        self.robust_parsing = True
        self.refused = 0
        self._verified = False
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
        """Bring the signing time up to the clock; it never goes back. at_least: what was stored, in ticks."""
        now = int((now_unix_s - SIGNING_EPOCH_S) * TICKS_PER_S)
        self.signing.timestamp = max(self.signing.timestamp, now, at_least)

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:
        """Whether a frame's signature is good: the hash first, then its time against the stream's, then ours."""
        digest = sha256(self.signing.secret_key + bytes(msgbuf[:-6])).digest()[:6]
        if not hmac.compare_digest(digest, bytes(msgbuf[-6:])):
            return False
        link, low, high = struct.unpack("<BIH", bytes(msgbuf[-SIGNED_TAIL:-6]))
        time, stream = low + (high << 32), (link, srcSystem, srcComponent)
        last = self.signing.stream_timestamps.get(stream)
        new = last is None
        if time > self.signing.timestamp + WINDOW_TICKS or (new and time + WINDOW_TICKS < self.signing.timestamp):
            return False
        if (not new and time <= last) or (new and len(self.signing.stream_timestamps) >= MAX_STREAMS):
            return False
        self.signing.stream_timestamps[stream] = time
        self._verified = True
        return True

    def decode(self, msgbuf: bytearray) -> common.MAVLink_message:
        """As pymavlink's, and whether the signature was good is kept on the message as `verified`."""
        self._verified = False
        message = super().decode(msgbuf)
        message.verified = self._verified
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
