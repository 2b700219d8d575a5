"""Bytes from a receiver -> whole, checksummed frames, of one protocol or of several that share the line.

The hazard is the byte that lies. A flipped bit turns a `$` into something else, a binary message into a false header
that claims 8 kB, an unplugged cable glues two halves of different sentences together. So nothing is used before
its checksum, and on any failed check the search resumes one byte after the sync that failed, never behind the length it
claimed: a false header costs itself and nothing more. A header that keeps claiming bytes which do not come is given up
after a time, or it would hold back every fix behind it. What no decoder knows is skipped as garbage.

The protocols are searched for side by side, by one pointer: what lies inside a frame of one is no frame of another.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

from edge.gnss.decoder import Decoder

HEADER_PATIENCE_S: Final = 1.0  # 3 kB of raw measurements at 38400 baud take 0.8 s; a false header delays us no longer


class Packet(NamedTuple):
    """One frame that passed its checksum. kind: the decoder's name; body: what that decoder cut out."""

    kind: str
    body: bytes


class Framer:
    """Cuts a byte stream into frames; fed with what the port gives, in pieces of any size.

    counts: bytes, frames of each protocol by its name, and failed checksums.
    """

    def __init__(self, decoders: Iterable[Decoder]) -> None:
        self._decoders = {decoder.sync: decoder for decoder in decoders}
        self._sync = re.compile(b"|".join(map(re.escape, self._decoders)))
        self._buffer = b""
        self._waiting_since_s: float | None = None
        self.counts: Counter[str] = Counter()

    @property
    def frames(self) -> int:
        """Whole frames so far, of any protocol."""
        return sum(self.counts[decoder.name] for decoder in self._decoders.values())

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
        while sync := self._sync.search(self._buffer, at):
            decoder = self._decoders[sync.group()]
            cut = decoder.cut(self._buffer, sync.start())
            if cut is None and not self._patience_over(t_s):
                self._buffer = self._buffer[sync.start() :]
                return
            self._waiting_since_s = None
            at = cut.end if cut else sync.start() + 1
            if cut and cut.checksum_failed:
                self.counts["bad checksum"] += 1
            if cut and cut.body is not None:
                self.counts[decoder.name] += 1
                yield Packet(decoder.name, cut.body)
        self._buffer = self._buffer[max(at, len(self._buffer) - self._half_a_sync()) :]

    def _patience_over(self, t_s: float) -> bool:
        if self._waiting_since_s is None:
            self._waiting_since_s = t_s
        return t_s - self._waiting_since_s > HEADER_PATIENCE_S

    def _half_a_sync(self) -> int:
        """How many of the last bytes may be the beginning of a sync."""
        halves = (sync[:length] for sync in self._decoders for length in range(1, len(sync)))
        return max((len(half) for half in halves if self._buffer.endswith(half)), default=0)
