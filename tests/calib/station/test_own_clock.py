"""The station looks at its own clock as its boxes do at theirs, and stops nothing for it."""

import pytest

from calib.station.own_clock import check_own_clock
from edge.clock.settings import ClockConfig
from edge.clock.state import ClockState, unknown


@pytest.mark.parametrize(
    ("state", "level"),
    [
        (ClockState(0.001, "chrony", True, "chrony follows 1.2.3.4 within 1 ms"), "ok"),
        (ClockState(0.5, "chrony", True, "chrony follows 1.2.3.4 within 500 ms"), "warn"),
        (ClockState(0.001, "chrony", True, "follows 1.2.3.4", conflict="5.6.7.8 says 300 ms otherwise"), "warn"),
        (unknown("chrony", "chronyd follows nobody and serves its own clock", "give it a source"), "warn"),
    ],
)
def test_who_is_followed_is_told_and_nothing_fails_for_it(state: ClockState, level: str) -> None:
    check = check_own_clock(state, ClockConfig())
    assert (check.name, check.level) == ("clock", level)
    assert state.reason in check.reason
    assert state.conflict in check.reason
