"""How unevenly frames arrive, and how unevenly they are stamped. Pure: both by second differences.

The hazard is the stamp that looks exact. A camera that stamps by twos, rounds to tenths of a second or by the moment
its encoder was done hands out times that are off by as much, and says nothing. But a true time is followed by the
arrival: what a stamp is uneven by, and the arrival is not, is the stamp's own error.
"""

import math
from collections import deque
from typing import Final

JITTER_FRAMES: Final = 100  # frames that tell how unevenly they arrive
JITTER_RANK: Final = 0.95  # of them
NO_PAUSE_S: Final = 0.25  # s: a second difference beyond it is a pause, or a stall of the network
LEAST_TRIPLES: Final = 20  # before the stamps' noise is told
FAR_OUT: Final = 3.0  # times the root mean square of second differences: as far as any stamp is off
SURE_ERRORS: Final = 2.0  # standard errors that the noise has to be above zero


class SecondDifference:
    """How far each value is from the middle between its neighbours; None until there are three."""

    def __init__(self) -> None:
        self._last: deque[float] = deque(maxlen=3)

    def next(self, value: float) -> float | None:
        """Of the value before, after one more."""
        self._last.append(value)
        if len(self._last) < 3:
            return None
        before, here, after = self._last
        return here - (before + after) / 2


class Jitter:
    """How unevenly frames arrive, s: by second differences, which a delay that grows steadily leaves at zero."""

    def __init__(self) -> None:
        self._delay = SecondDifference()
        self._seen: deque[float] = deque(maxlen=JITTER_FRAMES)

    def update(self, delay_s: float) -> None:
        """The delay of one more frame."""
        if (uneven_s := self._delay.next(delay_s)) is not None:
            self._seen.append(abs(uneven_s))

    @property
    def value_s(self) -> float:
        """What all but a few frames stay below."""
        return sorted(self._seen)[int(JITTER_RANK * len(self._seen))] if self._seen else 0.0


class StampNoise:
    """By how much stamps are off that arrivals do not follow, s; 0 while that is no more than chance.

    With second differences s of stamps and a of arrivals, a = s but for noise of both, and the mean of s (s - a) is the
    variance of the stamps' own.
    """

    def __init__(self) -> None:
        self._stream, self._arrival = SecondDifference(), SecondDifference()
        self._products: deque[float] = deque(maxlen=JITTER_FRAMES)
        self._sum = self._squares = 0.0

    def update(self, stream_s: float, arrival_s: float) -> None:
        """One more frame. Both count from anywhere; a year in a double is still good to a microsecond."""
        stamped, arrived = self._stream.next(stream_s), self._arrival.next(arrival_s)
        if stamped is None or arrived is None or max(abs(stamped), abs(arrived)) > NO_PAUSE_S:
            return
        if len(self._products) == JITTER_FRAMES:
            gone = self._products[0]
            self._sum, self._squares = self._sum - gone, self._squares - gone * gone
        product = stamped * (stamped - arrived)
        self._products.append(product)
        self._sum, self._squares = self._sum + product, self._squares + product * product

    @property
    def value_s(self) -> float | None:
        """As far as stamps are off by themselves; None until there are enough of them."""
        count = len(self._products)
        if count < LEAST_TRIPLES:
            return None
        mean = self._sum / count
        error = math.sqrt(max(0.0, self._squares / count - mean * mean) / count)
        return FAR_OUT * math.sqrt(mean) if mean > SURE_ERRORS * error else 0.0
