"""A recording's own times: begun again, missing, made up, jumping."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.capture.file_times import FileTimes, carry_times, has_no_container, usual_interval_s


def stamps_ms(times: FileTimes, at_ms: list[float], known: list[bool] | None = None) -> list[float]:
    return [times.next(t, known=k) / 1e6 for t, k in zip(at_ms, known or [True] * len(at_ms), strict=True)]


def test_times_that_begin_again_go_on_without_a_bound() -> None:
    times = FileTimes(usual_s=0.04)
    assert stamps_ms(times, [0, 40, 80, 0, 40, 80, 0, 40]) == [40.0 * k for k in range(8)]
    assert times.breaks == [(0.08, 0.0), (0.2, 0.12)]
    assert not times.bounded


def test_a_gap_is_told_and_a_jump_has_no_bound() -> None:
    times = FileTimes(usual_s=0.04)
    assert stamps_ms(times, [0, 40, 2040, 2080]) == [0, 40, 2040, 2080]
    assert (times.gaps, times.bounded) == ([(0.04, 2.04)], True)
    assert stamps_ms(times, [500_000.0]) == [500_000.0]
    assert not times.bounded


def test_frames_without_a_time_are_one_interval_after_the_last() -> None:
    times = FileTimes(usual_s=1 / 30)
    assert stamps_ms(times, [67, 100, 133, 0, 0], [True, True, True, False, False]) == [0, 33, 66, 99, 132]
    assert times.bounded


def test_a_beginning_that_does_not_decode_is_counted() -> None:
    times = FileTimes(usual_s=0.04, length_s=12.0)
    assert stamps_ms(times, [8300, 8340]) == [8300, 8340]
    assert not times.bounded
    assert stamps_ms(FileTimes(length_s=4.0), [37_250, 37_290]) == [0, 40]  # a file whose times count from elsewhere


def test_a_rate_counts() -> None:
    assert stamps_ms(FileTimes(fps=20), [0, 0, 0]) == [0, 50, 100]


@given(st.lists(st.floats(-1e6, 1e7), min_size=1, max_size=40))
def test_time_never_goes_back(at_ms: list[float]) -> None:
    stamps = stamps_ms(FileTimes(usual_s=0.04), at_ms)
    assert all(b >= a for a, b in itertools.pairwise(stamps))


@pytest.mark.parametrize(
    ("first_ms", "carried", "usual_s"),
    [([0, 40, 80], True, 0.04), ([0, 0, 0, 0], False, None), ([5.0], True, None), ([], True, None)],
)
def test_made_up_times_are_told(first_ms: list[float], carried: bool, usual_s: float | None) -> None:
    assert carry_times(first_ms) == carried
    assert usual_interval_s(first_ms) == usual_s


def test_bare_streams_are_told_by_their_first_bytes() -> None:
    assert [has_no_container(head) for head in (b"\xff\xd8\xff\xe0", b"\0\0\0\1", b"\0\0\1\xb3", b"\0\0\1\xba")] == [
        True,
        True,
        True,
        False,
    ]
    assert not has_no_container(b"\0\0\0\x20ftyp")
