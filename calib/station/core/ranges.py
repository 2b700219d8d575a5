"""Sets of sequence numbers: of millions that came in order, and of which some are missing, only the edges are kept."""

import bisect
from collections.abc import Iterable, Iterator


class Ranges:
    """A set of whole numbers as disjoint, sorted, closed ranges. Adding at the end costs nothing."""

    def __init__(self, ranges: Iterable[tuple[int, int]] = ()) -> None:
        self._firsts: list[int] = []
        self._lasts: list[int] = []
        for first, last in ranges:
            self.add(first, last)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return iter(zip(self._firsts, self._lasts, strict=True))

    def add(self, first: int, last: int) -> None:
        """Add the numbers first to last, both included; what touches is merged."""
        low = bisect.bisect_left(self._lasts, first - 1)
        high = bisect.bisect_right(self._firsts, last + 1)
        if low < high:
            first, last = min(first, self._firsts[low]), max(last, self._lasts[high - 1])
        self._firsts[low:high] = [first]
        self._lasts[low:high] = [last]

    def missing(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """The stretches between first and last, both included, that are not in the set."""
        for index in range(bisect.bisect_left(self._lasts, first), len(self._firsts)):
            if self._firsts[index] > last:
                break
            if first < self._firsts[index]:
                yield first, self._firsts[index] - 1
            first = self._lasts[index] + 1
        if first <= last:
            yield first, last

    def __contains__(self, number: int) -> bool:
        """Whether a number is in the set."""
        index = bisect.bisect_left(self._lasts, number)
        return index < len(self._firsts) and self._firsts[index] <= number
