"""From a stream's own time to UTC: the least delay counts, and its drift is taken off."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.capture.stamps import LeastDelay, StreamDrift
from tests.edge.capture.sources import MS, T0


@given(st.lists(st.floats(0, 500), min_size=1, max_size=60))
def test_least_delay_is_never_later_than_arrival_nor_earlier_than_the_least(delays_ms: list[float]) -> None:
    mapping = LeastDelay()
    for k, delay in enumerate(delays_ms):
        stream_ns, arrival_ns = k * 33 * MS, T0 + k * 33 * MS + round(delay * MS)
        t = mapping.arrived_ns(stream_ns, arrival_ns)
        assert t <= arrival_ns
        assert t - stream_ns - T0 == round(min(delays_ms[: k + 1]) * MS)


def test_drift_of_a_stream_is_taken_off() -> None:
    # A stream clock 50 ppm fast for ten minutes: 30 ms; delays of 20 ms and more, now and then the least.
    least, drift, worst_ms = LeastDelay(), StreamDrift(), 0.0
    rng = np.random.default_rng(7)
    for k in range(6000):
        true_ns = T0 + k * 100 * MS
        stream_ns = round(k * 100 * MS * (1 + 50e-6))
        arrived_ns = least.arrived_ns(stream_ns, true_ns + round(rng.exponential(10) * MS) + 20 * MS)
        sent_ns = T0 + stream_ns
        worst_ms = max(worst_ms, abs(sent_ns + drift.drift_ns(stream_ns, arrived_ns, sent_ns) - true_ns) / MS)
    # 1.5 ms before the reference is found, and as much again by which the least of 30 s lags behind.
    assert worst_ms < 4.0


def test_slow_minute_of_the_network_is_not_taken_for_drift() -> None:
    least, drift, worst_ms = LeastDelay(), StreamDrift(), 0.0
    for k in range(3000):
        stream_ns = k * 100 * MS
        slow_ns = 5000 * MS if 1000 <= k < 1900 else 0  # 90 s of 5 s delay: the least of 30 s is 5 s for 60 s
        arrived_ns = least.arrived_ns(stream_ns, T0 + stream_ns + 20 * MS + slow_ns)
        worst_ms = max(worst_ms, abs(drift.drift_ns(stream_ns, arrived_ns, T0 + stream_ns)) / MS)
    assert worst_ms == pytest.approx(6.5, abs=0.1)  # 100 ppm of 65 s: the 30 s are of arrivals, which were 5 s late
