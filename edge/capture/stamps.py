"""From the times a stream carries to UTC. Pure: what was observed is handed in.

Three hazards. A camera's presentation times count from nowhere, and only the sender's own report ties them to UTC.
Where there is no report, arrival is all there is: always late, by a delay that jumps, so the least delayed frames of a
while are the measure. And a presentation time rounded to whole frames is off by up to half a frame.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

ENVELOPE_S: Final = 30.0  # s of frames the least delay is sought in: clocks drift 1 ms in as long
ARRIVAL_BOUND_S: Final = 0.1  # s: network, decoder and buffer of an ordinary IP camera, measured 30 to 100 ms
SETTLED_S: Final = 2.0  # s of a stream until what was buffered while it was opened has run out
SENDER_BOUND_S: Final = (
    0.005  # s: resolution of a sender report seen through the decoder, beside the sender's own clock
)
SENSOR_BOUND_S: Final = 0.002  # s: driver stamps jitter by a USB microframe to a scheduler tick
MONOTONIC_PLAUSIBLE_S: Final = 10.0  # s: a driver stamp further than this from now is of another clock
NETWORK_HOLDS_S: Final = 10.0  # s: what buffers on the way to a box hold of a video stream, and more
FIRST_FRAMES: Final = 12  # after that, among which the least delay to begin with is sought
MOST_DRIFT_PPM: Final = 100.0  # of a quartz without a thermostat, and some


@dataclass
class LeastDelay:
    """Maps stream times to a clock that never steps, by the least delayed arrival of the last ENVELOPE_S."""

    _seen: deque[tuple[int, int]] = field(default_factory=deque)  # (stream ns, arrival minus stream ns), rising

    def arrived_ns(self, stream_ns: int, arrival_ns: int) -> int:
        """When a frame at stream_ns, which arrived at arrival_ns, would have with the least delay. Never later."""
        delay = arrival_ns - stream_ns
        while self._seen and self._seen[-1][1] >= delay:
            self._seen.pop()
        self._seen.append((stream_ns, delay))
        while self._seen[0][0] + self._seen[0][1] < arrival_ns - ENVELOPE_S * 1e9:  # what arrived too long ago
            self._seen.popleft()
        return stream_ns + self._seen[0][1]


@dataclass
class GrownDelay:
    """By how much frames may be later than ever: what their delay has grown by since it was least.

    A stream that runs slow and a network that holds frames back give the same numbers. More than NETWORK_HOLDS_S no
    network holds back: then it is the stream, and its arrival alone counts while it runs so. grown_s: that of the last
    frame; to begin with, what was there before.
    """

    grown_s: float = 0.0
    _least_ns: float | None = None
    _last_arrival_ns: int = 0
    _runs_slow: bool = False

    def update_s(self, stream_ns: int, arrival_ns: int, *, runs_true: bool) -> float:
        """The growth, s, after one more frame. runs_true: whether stream time runs at one second a second."""
        delay_ns = float(arrival_ns - stream_ns)
        if self._runs_slow and runs_true:
            self._runs_slow, self._least_ns = False, None
        if self._least_ns is None:
            self._least_ns, self._last_arrival_ns = delay_ns - self.grown_s * 1e9, arrival_ns
        leak_ns = MOST_DRIFT_PPM * 1e-6 * (arrival_ns - self._last_arrival_ns)
        self._least_ns = min(self._least_ns + leak_ns, delay_ns)
        self._last_arrival_ns = arrival_ns
        grown_s = (delay_ns - self._least_ns) / 1e9
        self._runs_slow = self._runs_slow or grown_s > NETWORK_HOLDS_S
        self.grown_s = 0.0 if self._runs_slow else grown_s
        return self.grown_s


@dataclass
class ShrunkDelay:
    """By how much frames may be stamped too late: what their least delay has become less by since the stream settled.

    A stream that runs fast, or jumps ahead by less than its delay, and a network that becomes quicker look the same.
    """

    _begin_ns: int | None = None
    _frames: int = 0
    _at_first_s: float = math.inf
    _least_s: float = math.inf

    def update_s(self, arrival_ns: int, delay_s: float) -> float | None:
        """The loss, s, after one more frame; None until it is known what there was to lose."""
        if self._begin_ns is None:
            self._begin_ns = arrival_ns
        if arrival_ns - self._begin_ns < SETTLED_S * 1e9:  # what was buffered while the stream was opened comes late
            return None
        self._frames += 1
        self._least_s = min(self._least_s, delay_s)
        if self._frames <= FIRST_FRAMES:
            self._at_first_s = self._least_s
            return None
        return self._at_first_s - self._least_s


@dataclass
class StreamDrift:
    """How far a stream's clock has run away from its sender's since its first report, which is all we are told of.

    Decoders tie a stream to the sender's clock once, at the first report; at 50 ppm that is 180 ms wrong after an hour.
    The least delay stays as it was, so what it seems to have changed by is the drift. But a network that is slow for a
    minute changes it too, by seconds; so the drift is only let grow as fast as a clock's can.
    """

    _first_stream_ns: int | None = None
    _reference_ns: int | None = None
    _last_stream_ns: int = 0
    _drift_ns: float = 0.0

    def drift_ns(self, stream_ns: int, least_delayed_ns: int, sent_unix_ns: int) -> int:
        """The drift at a frame; 0 until a first stretch of ENVELOPE_S has shown what the least delay is."""
        if self._first_stream_ns is None:
            self._first_stream_ns = stream_ns
        delay_ns = least_delayed_ns - sent_unix_ns
        if self._reference_ns is None and stream_ns - self._first_stream_ns >= ENVELOPE_S * 1e9:
            self._reference_ns = delay_ns
        if self._reference_ns is not None:
            most_ns = MOST_DRIFT_PPM * 1e-6 * max(0, stream_ns - self._last_stream_ns)
            change_ns = delay_ns - self._reference_ns - self._drift_ns
            self._drift_ns += min(max(change_ns, -most_ns), most_ns)
        self._last_stream_ns = stream_ns
        return round(self._drift_ns)


@dataclass
class FrameRounding:
    """The mean of (rounded presentation time - exact position), which ties exact positions to the sender's clock."""

    _sum_ms: float = 0.0
    _count: int = 0

    def offset_ms(self, rounded_ms: float, exact_ms: float) -> float:
        """The mean after one more pair."""
        self._sum_ms += rounded_ms - exact_ms
        self._count += 1
        return self._sum_ms / self._count
