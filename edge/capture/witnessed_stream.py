"""A frame's time from three witnesses: the stream's own time, what the sender says of it, and the arrival. Pure.

The hazard is the one that is believed alone. Cheap cameras stamp 12 frames a second as 25; restreamers begin their time
anew and recorders throw in frames of another day; a camera's clock is an hour off, or is set while it runs. The box
knows when each frame arrived. No frame was taken after that, and an ordinary camera's not long before: what contradicts
this is anchored anew, or its bound is widened by as much as the contradiction says, and the number is told. A stream
that begins to run slow and a network whose delay grows look the same: until it is more than a network can hold back,
the bound covers both.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from edge.capture.frame import Remark, TimeSource
from edge.capture.stamps import (
    ARRIVAL_BOUND_S,
    SENDER_BOUND_S,
    SETTLED_S,
    GrownDelay,
    LeastDelay,
    ShrunkDelay,
    StreamDrift,
)
from edge.capture.unevenness import Jitter, StampNoise
from edge.common.utc import Dated

JUMPED_S: Final = 1.0  # s by which stream time may run ahead of arrival between two frames, or fall back
STRAY_FRAMES: Final = 5  # frames in a row after a jump that make it the stream's new time
AFTER_ARRIVAL_S: Final = 0.05  # s after its arrival that a frame was taken by its sender: one of the clocks is wrong
HOPELESS_S: Final = 2.0  # s that even the least delayed frame lies before its arrival: the sender's clock is wrong
TRUE_RATE: Final = 0.08  # share by which the rate of stream time may be off: 60 ms of jitter in a block, five blocks
RATE_BLOCK_S: Final = 1.0  # s over which a rate is taken
RATE_BLOCKS: Final = 5  # whose median is the rate: one stall of the network is one block
SENDER_SLACK_S: Final = 0.005  # s of growing delay that the sender's bound covers by itself
SHRUNK_SLACK_S: Final = 0.003  # s by which the least delay becomes less by chance
JITTER_FACTOR: Final = 1.5  # times the jitter that a delay may have grown without a word


@dataclass(frozen=True)
class StreamStamp:
    """A frame's time; bound_s: how far it may be off beside the clock of whom it comes from, None if nobody knows."""

    t_unix_ns: int
    source: TimeSource
    bound_s: float | None


class Rate:
    """Seconds of stream time per second, by the median of blocks; None until there are enough of them."""

    def __init__(self) -> None:
        self._begin: tuple[int, int] | None = None
        self._blocks: deque[float] = deque(maxlen=RATE_BLOCKS)

    def update(self, stream_ns: int, arrival_ns: int) -> None:
        """One more frame."""
        if self._begin is None:
            self._begin = (stream_ns, arrival_ns)
        passed_ns = arrival_ns - self._begin[1]
        if passed_ns >= RATE_BLOCK_S * 1e9:
            self._blocks.append((stream_ns - self._begin[0]) / passed_ns)
            self._begin = (stream_ns, arrival_ns)

    @property
    def value(self) -> float | None:
        """The rate, or None."""
        return sorted(self._blocks)[RATE_BLOCKS // 2] if len(self._blocks) == RATE_BLOCKS else None


class WitnessedStream:
    """Dates the frames of one opening of a stream. remarks: what its witnesses say against each other, so far."""

    def __init__(self) -> None:
        self._drift = StreamDrift()
        self._sender_failed = False
        self._remarks: dict[str, Remark] = {}
        self._last: tuple[int, int] | None = None  # stream and arrival of the last frame of the stream's own time
        self._strays: list[tuple[int, int]] = []
        self._anchor()

    def _anchor(self, grown_s: float = 0.0) -> None:
        """Begin anew with all that is learned of how stream time and arrival go together, but for a delay there is."""
        self._line = LeastDelay()
        self._grown = GrownDelay(grown_s)
        self._rate = Rate()
        self._jitter = Jitter()
        self._noise = StampNoise()
        self._shrunk = ShrunkDelay()
        self._first_arrival_ns: int | None = None
        self._least_delay_s: float | None = None
        self._last_arrival_ns: int | None = None

    @property
    def remarks(self) -> list[Remark]:
        """What the operator should know of this stream's time."""
        return list(self._remarks.values())

    def stamp(
        self, stream_ns: int, arrival_ns: int, sent_unix_ns: int | None, date: Callable[[int], Dated]
    ) -> StreamStamp:
        """One more frame. arrival_ns: monotonic. sent_unix_ns: by the sender. date: UTC of a monotonic time."""
        if self._is_stray(stream_ns, arrival_ns):
            return StreamStamp(date(arrival_ns).t_unix_ns, "arrival", None)
        self._rate.update(stream_ns, arrival_ns)
        if self._first_arrival_ns is None:
            self._first_arrival_ns = arrival_ns
        settled = arrival_ns - self._first_arrival_ns >= SETTLED_S * 1e9
        line_ns = self._line.arrived_ns(stream_ns, arrival_ns)
        late_s = (arrival_ns - line_ns) / 1e9
        self._jitter.update(late_s)
        self._noise.update(stream_ns / 1e9, arrival_ns / 1e9)
        runs_true = self._runs_true()
        grown_s = self._grown.update_s(stream_ns, arrival_ns, runs_true=runs_true)
        if runs_true:
            sent = self._sent(stream_ns, arrival_ns, line_ns, sent_unix_ns, date)
            if sent is not None:
                return sent
            dated = date(line_ns)
            bound_s = max(ARRIVAL_BOUND_S, late_s) + max(0.0, grown_s - late_s - SENDER_SLACK_S) + dated.doubt_s
            return StreamStamp(dated.t_unix_ns, "arrival", bound_s if settled else None)
        dated = date(arrival_ns)
        jitter_s = JITTER_FACTOR * self._jitter.value_s
        bound_s = ARRIVAL_BOUND_S + jitter_s + self._overdue_s(arrival_ns) + grown_s + dated.doubt_s
        return StreamStamp(dated.t_unix_ns, "arrival", bound_s if settled else None)

    def _is_stray(self, stream_ns: int, arrival_ns: int) -> bool:
        """Whether a frame is of another time than the stream's; several of one other time make that the stream's."""
        if self._last is None or not _jumped(self._last, (stream_ns, arrival_ns)):
            self._last, self._strays = (stream_ns, arrival_ns), []
            return False
        if self._strays and _jumped(self._strays[-1], (stream_ns, arrival_ns)):
            self._strays = []
        self._strays.append((stream_ns, arrival_ns))
        jump_s = (stream_ns - self._last[0] - (arrival_ns - self._last[1])) / 1e9
        if len(self._strays) < STRAY_FRAMES:
            said = f"frames come that are dated {jump_s:+.1f} s from those before"
            self._say("stray", said + ": they are timed by their arrival, without a bound")
            return True
        self._say("jump", f"its stream time jumped by {jump_s:+.1f} s: frames are timed by arrival since")
        self._remarks.pop("stray", None)
        self._sender_failed = True  # what the sender said was of the time before
        self._anchor(self._grown.grown_s + self._grown_meanwhile_s())
        self._last, self._strays = (stream_ns, arrival_ns), []
        return False

    def _grown_meanwhile_s(self) -> float:
        """How much later frames came while the stream's new time was in doubt, the step to its first one too."""
        (first_ns, first_arrival_ns), (last_ns, last_arrival_ns) = self._strays[0], self._strays[-1]
        grown_s = (last_arrival_ns - first_arrival_ns - (last_ns - first_ns)) / 1e9
        return max(0.0, grown_s) * STRAY_FRAMES / (STRAY_FRAMES - 1)

    def _runs_true(self) -> bool:
        rate = self._rate.value
        if rate is None or abs(rate - 1) <= TRUE_RATE:
            return True
        said = f"its stream time runs at {rate:.2f} s a second: frames are timed by their arrival alone"
        self._say("rate", said)
        return False

    def _overdue_s(self, arrival_ns: int) -> float:
        """How much longer than a frame or two nothing came before this frame, which may be what it is late by."""
        before_ns, self._last_arrival_ns = self._last_arrival_ns, arrival_ns
        return 0.0 if before_ns is None else max(0.0, (arrival_ns - before_ns) / 1e9 - ARRIVAL_BOUND_S)

    def _sent(
        self, stream_ns: int, arrival_ns: int, line_ns: int, sent_unix_ns: int | None, date: Callable[[int], Dated]
    ) -> StreamStamp | None:
        """The sender's time, as wide as arrivals contradict it; None where there is none, or it cannot be."""
        if sent_unix_ns is None or self._sender_failed:
            return None
        dated = date(arrival_ns)
        if dated.doubt_s:  # this box's UTC was stepped: what was learned was against another
            self._least_delay_s, self._shrunk = None, ShrunkDelay()
        sent_ns = sent_unix_ns + self._drift.drift_ns(stream_ns, date(line_ns).t_unix_ns, sent_unix_ns)
        delay_s = (dated.t_unix_ns - sent_ns) / 1e9
        least_s = self._least_delay_s = min(delay_s, delay_s if self._least_delay_s is None else self._least_delay_s)
        if least_s < -AFTER_ARRIVAL_S or least_s > HOPELESS_S:
            self._say_clock(least_s)
            return None
        grown_s = delay_s - least_s
        shrunk_s, noise_s = self._shrunk.update_s(arrival_ns, delay_s), self._noise.value_s
        if shrunk_s is None or noise_s is None:
            return StreamStamp(sent_ns, "sender", None)
        bound_s = SENDER_BOUND_S + noise_s
        if shrunk_s > SHRUNK_SLACK_S:
            bound_s += shrunk_s + JITTER_FACTOR * self._jitter.value_s
        if least_s < -SENDER_BOUND_S:  # no frame is taken after it arrives: how long it was on its way, nobody knows
            bound_s = max(bound_s, ARRIVAL_BOUND_S - least_s)
            said = f"its clock says {-least_s * 1e3:.0f} ms after frames arrive: its stamps are as uncertain, and more"
            self._say("ahead", said)
        if grown_s > max(SENDER_SLACK_S, JITTER_FACTOR * self._jitter.value_s):
            bound_s = max(bound_s, delay_s)  # taken at some time between the sender's and the arrival
        elif grown_s > SENDER_SLACK_S:  # as uneven as ever; but so begins a stream that slows down
            bound_s += grown_s
        if least_s > ARRIVAL_BOUND_S:  # a delay longer than any ordinary one, or a clock that is slow
            self._say("slow", f"its clock says {least_s:.2f} s before frames arrive: its stamps are as uncertain")
            bound_s = max(bound_s, delay_s)
        else:
            self._remarks.pop("slow", None)  # it was what was buffered while the stream was opened
        return StreamStamp(sent_ns, "sender", bound_s)

    def _say_clock(self, least_s: float) -> None:
        where = f"{-least_s:.1f} s after" if least_s < 0 else f"{least_s:.1f} s before"
        said = f"its clock dates frames {where} they arrive by this box's clock: they are timed by arrival"
        self._say("clock", said)

    def _say(self, key: str, what: str) -> None:
        self._remarks[key] = Remark(what, _ACTIONS[key])


_ACTIONS: Final = {
    "stray": "ask the camera for its stream directly, and not through a recorder",
    "jump": "restart the camera's stream, or whatever passes it on, to have the sender's time again",
    "rate": "set the camera to a fixed frame rate; use RTSP instead of HTTP",
    "ahead": "set the camera's clock by NTP, or this box's if it is wrong",
    "slow": "set the camera's clock by NTP; let it send without buffering",
    "clock": "set the camera's clock by NTP, or this box's if it is wrong",
}


def _jumped(before: tuple[int, int], here: tuple[int, int]) -> bool:
    """Whether stream time, ns, fell back or ran ahead of arrival, ns, between two frames."""
    passed_ns, arrived_ns = here[0] - before[0], here[1] - before[1]
    return passed_ns < -JUMPED_S * 1e9 or passed_ns - arrived_ns > JUMPED_S * 1e9
