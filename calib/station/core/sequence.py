"""Which of a box's messages is its next, and which is an old one sent again. Pure: numbers and times are handed in.

The hazard is whoever has a box's certificate, or its twin with the same name: he repeats what it sent an hour ago or
in an earlier start, or numbers a message so high that every honest one after it seems old. So an earlier start is
accepted only when the later one has long been silent, and a number can rise no faster than any box can count. Nothing
here moves until the message is accepted in every other respect too: `judge` asks, `take` moves on.
"""

from dataclasses import dataclass
from typing import Final, Literal

from edge.common.units import NS

SILENT_NS: Final = 20 * NS  # of arrival time: a start that has been silent for so long may be replaced by an older one
LEAP: Final = 20_000  # numbers that may be missing at once: ten minutes at 30 Hz, whatever the arrival clock says
RATE_HZ: Final = 1000  # and beyond that, so many for each second of silence; a box counts frames

Verdict = Literal["next", "start", "repeated", "earlier", "leapt"]


@dataclass
class Sequence:
    """How far one camera's messages have come. Times are of the arrival clock."""

    epoch: int | None = None
    next_seq: int = 0
    last_ns: int = 0

    def judge(self, epoch: int, seq: int, now_ns: int) -> Verdict:
        """What a message is by its numbers: the next one, the first of another start, or one to refuse."""
        silence_ns = now_ns - self.last_ns
        if epoch != self.epoch:
            earlier = self.epoch is not None and epoch < self.epoch and silence_ns < SILENT_NS
            return "earlier" if earlier else "start"
        if seq < self.next_seq:
            return "repeated"
        return "leapt" if seq - self.next_seq > LEAP + RATE_HZ * silence_ns // NS else "next"

    def take(self, epoch: int, seq: int, now_ns: int) -> int:
        """Move on to a message that was accepted; how many before it are missing."""
        missing = seq - self.next_seq if epoch == self.epoch else 0
        self.epoch, self.next_seq, self.last_ns = epoch, seq + 1, now_ns
        return missing
