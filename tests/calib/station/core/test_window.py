"""The window is bounded, and keeps whole frames, whatever the frames are like."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from calib.observations import Frame
from calib.station.core.window import GROWTH, SPARE_ROWS, CameraWindow
from edge.messages import MAX_DETECTIONS

LIMIT = 500
NS = 10**9


def frame(t_unix_ns: int, rows: int) -> Frame:
    labels = np.arange(rows, dtype=np.int64)
    return Frame("cam0", t_unix_ns, np.zeros((rows, 2)), labels, np.ones(rows), np.ones(rows))


@given(st.lists(st.one_of(st.sampled_from([0, 1, 2, MAX_DETECTIONS]), st.integers(0, MAX_DETECTIONS)), max_size=60))
def test_no_order_of_frame_sizes_overflows_it(sizes: list[int]) -> None:
    window = CameraWindow(LIMIT)
    for number, size in enumerate(sizes):
        window.add(frame(number * NS // 2, size))
        assert len(window) <= int(LIMIT * GROWTH) + SPARE_ROWS
    kept = window.observations()
    assert len(kept.t_unix_ns) <= LIMIT
    assert np.all(np.diff(kept.t_unix_ns) >= 0)


def test_a_flood_in_every_other_frame() -> None:
    """By turns 1000 and 1: thinning by every other frame frees nothing, and ended the station."""
    window = CameraWindow(LIMIT)
    for number in range(400):
        window.add(frame(number * NS // 30, MAX_DETECTIONS if number % 2 == 0 else 1))
    assert max(window.seconds) == 399 // 30
    assert min(window.seconds) >= 12, "what was dropped is not counted as seen"


def test_the_newest_frame_is_always_whole() -> None:
    window = CameraWindow(None)
    window.add(frame(0, 3))
    window.add(frame(NS, MAX_DETECTIONS))
    assert len(window) == 3 + MAX_DETECTIONS
