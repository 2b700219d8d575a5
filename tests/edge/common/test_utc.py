"""Monotonic -> UTC: interpolated while slewed, and a step counted without reaching back."""

import time

import numpy as np
import pytest
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


@pytest.mark.parametrize("step_ms", [500, -500, -1000, 1000, 250, -50 * 86_400_000, 300_000_000_000, -12])
def test_a_step_marks_the_frames_about_it_and_no_other(step_ms: int) -> None:
    """0.5 s, a leap second, fifty days, the first word of UTC since 1970: a camera at 30 Hz, dated as it comes."""
    clocks = Clocks()
    mapping = clocks.mapping()
    wrong, marked = [], []
    for k in range(90):
        clocks.monotonic += 33 * MS
        if k == 45:
            clocks.offset += step_ms * MS
        if k % 30 == 0:
            mapping.refresh()
        exposed = clocks.monotonic - 10 * MS  # a frame of before the step, dated after it
        truth = OFFSET_NS + (step_ms * MS if k > 45 else 0)
        dated = mapping.date(exposed)
        error_s = abs(dated.t_unix_ns - exposed - truth) * 1e-9
        assert error_s <= dated.doubt_s + 1e-6
        wrong += [k] if error_s > 1e-6 else []
        marked += [k] if dated.doubt_s > 0 else []
    assert set(wrong) <= set(marked)
    assert marked == [45]
    assert mapping.steps == 1


@given(st.lists(st.integers(-5_000, 5_000).filter(lambda ms: abs(ms) > 2), max_size=5), st.integers(0, 2**32))
def test_no_frame_is_farther_off_than_it_says(steps_ms: list[int], seed: int) -> None:
    clocks, random = Clocks(), np.random.default_rng(seed)
    mapping = clocks.mapping()
    at = dict(zip(random.choice(np.arange(5, 200), len(steps_ms), replace=False), steps_ms, strict=True))
    truth = {0: clocks.offset}
    for k in range(200):
        clocks.monotonic += round(float(random.uniform(1, 60)) * MS)
        if k in at:
            clocks.offset += at[k] * MS
            truth[clocks.monotonic] = clocks.offset
        if random.random() < 0.05:
            mapping.refresh()
        exposed = clocks.monotonic - round(float(random.uniform(0, 50)) * MS)
        offset = truth[max(since for since in truth if since <= exposed)]
        dated = mapping.date(exposed)
        assert abs(dated.t_unix_ns - exposed - offset) * 1e-9 <= dated.doubt_s + 1e-6


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
