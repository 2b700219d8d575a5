"""Monotonic -> UTC: interpolated while slewed, and a step counted without reaching back."""

import time

from hypothesis import given
from hypothesis import strategies as st

from edge.common.utc import UtcMapping, compare

OFFSET_NS = 1_790_000_000 * 10**9
MS = 1_000_000


class Clocks:
    """Two clocks that are moved by hand; a reading takes 100 ns."""

    def __init__(self) -> None:
        self.monotonic = 10**12
        self.offset = OFFSET_NS

    def monotonic_ns(self) -> int:
        """Read the monotonic clock."""
        self.monotonic += 100
        return self.monotonic

    def unix_ns(self) -> int:
        """Read UTC."""
        self.monotonic += 100
        return self.monotonic + self.offset

    def mapping(self) -> UtcMapping:
        """A mapping between the two."""
        return UtcMapping(self.monotonic_ns, self.unix_ns)


def test_a_stamp_is_converted() -> None:
    clocks = Clocks()
    mapping = clocks.mapping()
    assert abs(mapping.unix_ns(clocks.monotonic) - (clocks.monotonic + OFFSET_NS)) <= 200


def test_a_stamp_between_two_comparisons_is_interpolated() -> None:
    clocks = Clocks()
    mapping = clocks.mapping()
    start = clocks.monotonic
    clocks.monotonic += 1000 * MS
    clocks.offset += MS // 2  # slewed by 500 ppm
    mapping.refresh()
    middle = start + 500 * MS
    assert abs(mapping.unix_ns(middle) - (middle + OFFSET_NS + MS // 4)) <= 1000
    assert mapping.steps == 0


def test_a_step_is_counted_and_does_not_reach_back() -> None:
    clocks = Clocks()
    mapping = clocks.mapping()
    before = clocks.monotonic
    clocks.monotonic += 1000 * MS
    clocks.offset += 250 * MS
    mapping.refresh()
    assert mapping.steps == 1
    assert abs(mapping.unix_ns(before) - (before + OFFSET_NS)) <= 200
    # Between the two comparisons nobody knows when it happened: the frame keeps the time it was taken with.
    assert abs(mapping.unix_ns(before + 500 * MS) - (before + 500 * MS + OFFSET_NS)) <= 200
    after = clocks.monotonic + MS
    assert abs(mapping.unix_ns(after) - (after + OFFSET_NS + 250 * MS)) <= 200


def test_asking_for_now_notices_a_step_at_once() -> None:
    clocks = Clocks()
    mapping = clocks.mapping()
    clocks.monotonic += 10 * MS
    clocks.offset -= 30 * MS
    mapping.now_unix_ns()
    assert mapping.steps == 1


def test_the_narrowest_bracket_wins() -> None:
    clocks = Clocks()
    slow = iter([190_000, 0, 0, 0, 0])

    def held_up_ns() -> int:
        clocks.monotonic += next(slow, 0)
        return clocks.unix_ns()

    assert compare(clocks.monotonic_ns, held_up_ns, tries=5).width_ns == 200


def test_the_history_is_bounded_and_old_stamps_still_convert() -> None:
    clocks = Clocks()
    mapping = clocks.mapping()
    first = clocks.monotonic
    for _ in range(4000):
        clocks.monotonic += 1000 * MS
        mapping.refresh()
    assert len(mapping._history) == 3600
    assert abs(mapping.unix_ns(first) - (first + OFFSET_NS)) <= 200


def test_the_real_clocks() -> None:
    mapping = UtcMapping()
    assert mapping.refresh().width_ns < 1_000_000
    # A busy machine may hold a thread up between the two readings.
    assert abs(mapping.unix_ns(time.monotonic_ns()) - time.time_ns()) < 50 * MS


@given(st.lists(st.integers(-1_000, 1_000), min_size=1, max_size=50), st.floats(0, 1))
def test_slewed_time_never_runs_backwards(slews_ppm: list[int], share: float) -> None:
    clocks = Clocks()
    mapping = clocks.mapping()
    start = clocks.monotonic
    for slew in slews_ppm:
        clocks.monotonic += 1000 * MS
        clocks.offset += slew * 1000
        mapping.refresh()
    span = clocks.monotonic - start
    stamps = [start + round(span * (share + i) / 20) for i in range(20)]
    converted = [mapping.unix_ns(stamp) for stamp in stamps]
    assert converted == sorted(converted)
    assert mapping.steps == 0
