"""Bytes from a receiver -> whole, checksummed frames: NMEA sentences and UBX messages.

The hazard is the byte that lies. A flipped bit turns a `$` into something else, a binary message into a false header
that claims 8 kB, an unplugged cable glues two halves of different sentences together. So nothing is believed before
its checksum, and on any failed check the search resumes one byte after the sync that failed, never behind the length it
claimed: a false header costs itself and nothing more. A header that keeps claiming bytes which do not come is given up
after a time, or it would hold back every fix behind it. RTCM, proprietary binary and noise are skipped as garbage.
"""

import re
from collections import Counter
from collections.abc import Iterator
from functools import reduce
from operator import xor
from typing import Final, Literal, NamedTuple

MAX_SENTENCE: Final = 256  # bytes: high-precision sentences exceed the standard's 82, and none exceeds this
MAX_UBX_PAYLOAD: Final = 8192  # bytes: the longest message of a u-blox F9 is shorter
HEADER_PATIENCE_S: Final = 1.0  # 3 kB of raw measurements at 38400 baud take 0.8 s; a false header delays us no longer

_SYNC: Final = re.compile(rb"\$|\xb5\x62")
_SENTENCE: Final = re.compile(rb"\$([ -#%-)+-~]{5,250})\*([0-9A-Fa-f]{2})")
_UNFINISHED: Final = re.compile(rb"\$[ -#%-)+-~]{0,250}(?:\*[0-9A-Fa-f]?)?\Z")


class Packet(NamedTuple):
    """One frame that passed its checksum. NMEA: the text between `$` and `*`. UBX: the whole message, sync included."""

    kind: Literal["nmea", "ubx"]
    body: bytes


class Framer:
    """Cuts a byte stream into frames; fed with what the port gives, in pieces of any size."""

    def __init__(self) -> None:
        self._buffer = b""
        self._waiting_since_s: float | None = None
        self.counts: Counter[str] = Counter()

    def feed(self, data: bytes, t_s: float) -> list[Packet]:
        """The frames completed by `data` that arrived at monotonic t_s. Feed b"" now and then when nothing comes."""
        self.counts["bytes"] += len(data)
        self._buffer += data
        return list(self._frames(t_s))

    def reset(self) -> None:
        """Forget half a frame: what follows comes from another connection."""
        self._buffer = b""
        self._waiting_since_s = None

    def _frames(self, t_s: float) -> Iterator[Packet]:
        at = 0
        while sync := _SYNC.search(self._buffer, at):
            start = sync.start()
            parsed = self._sentence(start) if sync.group() == b"$" else self._ubx(start)
            if parsed is None and not self._patience_over(t_s):
                self._keep_from(start)
                return
            self._waiting_since_s = None
            frame, at = parsed or (None, start + 1)
            if frame:
                self.counts[frame.kind] += 1
                yield frame
        # A lone 0xB5 may be half a sync.
        self._keep_from(len(self._buffer) - (1 if self._buffer.endswith(b"\xb5") else 0))

    def _patience_over(self, t_s: float) -> bool:
        if self._waiting_since_s is None:
            self._waiting_since_s = t_s
        return t_s - self._waiting_since_s > HEADER_PATIENCE_S

    def _keep_from(self, start: int) -> None:
        self._buffer = self._buffer[start:]

    def _sentence(self, start: int) -> tuple[Packet | None, int] | None:
        """The sentence at `start` and where to go on; no frame if there is none there; None if it may yet come."""
        found = _SENTENCE.match(self._buffer, start)
        if found is None:
            return None if _UNFINISHED.match(self._buffer, start) else (None, start + 1)
        if reduce(xor, found[1]) != int(found[2], 16):
            self.counts["bad checksum"] += 1
            return None, start + 1
        return Packet("nmea", found[1]), found.end()

    def _ubx(self, start: int) -> tuple[Packet | None, int] | None:
        """As _sentence, for a UBX message."""
        if len(self._buffer) < start + 6:
            return None
        length = int.from_bytes(self._buffer[start + 4 : start + 6], "little")
        end = start + 8 + length
        if length > MAX_UBX_PAYLOAD:
            return None, start + 1
        if len(self._buffer) < end:
            return None
        if fletcher(self._buffer[start + 2 : end - 2]) != self._buffer[end - 2 : end]:
            self.counts["bad checksum"] += 1
            return None, start + 1
        return Packet("ubx", self._buffer[start:end]), end


def fletcher(data: bytes) -> bytes:
    """The two check bytes of a UBX message over class, id, length and payload (u-blox interface description, 3.4)."""
    a = b = 0
    for byte in data:
        a += byte
        b += a
    return bytes((a & 0xFF, b & 0xFF))
