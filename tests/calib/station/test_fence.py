"""What is raised inside a fence ends there, is counted, and is spoken of for a while."""

import logging

import pytest

from calib.station.fence import SPOKEN_OF_NS, Fence

T = 1_800_000_000 * 10**9


def test_a_fault_is_kept_counted_and_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    fence = Fence("messages", "warn", "report it")
    with caplog.at_level(logging.ERROR):
        for _ in range(5):
            with fence:
                raise ValueError("too wide")
    assert fence.count == 5
    assert len(caplog.records) == 1
    (check,) = fence.checks(T)
    assert (check.name, check.level, check.action) == ("messages", "warn", "report it")
    assert check.reason == "5 failed, the last with ValueError('too wide')"
    assert fence.checks(T + SPOKEN_OF_NS) == []


def test_what_ends_a_program_goes_through() -> None:
    with pytest.raises(KeyboardInterrupt), Fence("messages", "warn", "report it"):
        raise KeyboardInterrupt
