"""Names of pictures: their order, and the times that people and loggers write into them."""

import numpy as np
import pytest

from edge.capture.picture_names import natural, understand

T_NS = 1_780_000_123_456_789_012
WAYS = {
    "UNIX nanoseconds": lambda ns: f"cam1_{ns}",
    "UNIX microseconds": lambda ns: f"{ns // 1000}_rgb",
    "UNIX milliseconds": lambda ns: f"frame-{ns // 10**6}",
    "UNIX seconds": lambda ns: f"{ns // 10**9}.{ns % 10**9 // 1000:06d}",
}


@pytest.mark.parametrize("seed", range(20))
def test_times_in_names_are_read_in_their_unit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    steps = np.cumsum(rng.integers(20, 400, 12)) * 10**6
    for what, write in WAYS.items():
        stems = [write(T_NS + int(step)) for step in steps]
        times = understand(stems)
        assert (times.what, times.absolute) == (what, True), f"seed {seed}"
        read = np.array([times.of(stem) for stem in stems], dtype=np.int64)
        assert np.abs(read - T_NS - steps).max() < 10**6


@pytest.mark.parametrize(
    ("stem", "ns"),
    [
        ("20260528_202843_456", 456_000_000),
        ("IMG_20260528-202843.25", 250_000_000),
        ("2026-05-28T20:28:43.456789", 456_789_000),
        ("2026-05-28_20-28-43", 0),
        ("2026.05.28 20.28.43,5", 500_000_000),
    ],
)
def test_dates_are_read_as_utc(stem: str, ns: int) -> None:
    times = understand([stem])
    assert times.absolute
    assert times.of(stem) == 1_780_000_123 * 10**9 + ns


@pytest.mark.parametrize("seed", range(20))
def test_numbers_are_in_natural_order_and_keep_their_gaps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    numbers = np.sort(rng.choice(np.arange(1, 12_000), 30, replace=False)).tolist()
    names = [f"img{number}.jpg" for number in numbers]
    assert sorted(rng.permutation(names).tolist(), key=natural) == names
    times = understand([name[:-4] for name in names])
    assert [times.of(name[:-4]) for name in names] == numbers
    assert not times.absolute


def test_what_tells_nothing_apart_is_no_time() -> None:
    assert understand(["20260528_202843_a", "20260528_202843_b"]).what == "order"  # one second for both
    assert understand(["1700000000_1", "1700000000_2"]).what == "numbers"
    assert understand(["a_640_0001", "b_640_0002"]).of("b_640_0002") == 2
    assert understand(["0001_640", "0002_640"]).of("0002_640") == 2
    assert understand([]).what == "order"
