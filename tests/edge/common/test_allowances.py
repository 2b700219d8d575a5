"""Nobody gets more than its share, and nobody's share is another's."""

from hypothesis import given
from hypothesis import strategies as st

from edge.common.allowances import Allowances


@given(st.lists(st.floats(0, 0.1), min_size=1, max_size=200))
def test_never_more_than_burst_and_rate_allow(pauses: list[float]) -> None:
    allowances, now, taken = Allowances(rate_hz=10, burst=5), 0.0, 0
    for pause in pauses:
        now += pause
        taken += allowances.take("flood", now)
    assert taken <= 5 + now * 10 + 1e-6


def test_an_honest_key_is_untouched_by_a_flood() -> None:
    allowances = Allowances(rate_hz=100, burst=10)
    for tick in range(1000):
        now = tick / 30
        assert allowances.take("honest", now)
        for _ in range(100):
            allowances.take("flood", now)


def test_inventing_keys_costs_no_memory() -> None:
    allowances = Allowances(rate_hz=1000, burst=2000, max_keys=100)
    for number in range(1000):
        allowances.take(str(number), 0.0)
    assert len(allowances._left) <= 100
