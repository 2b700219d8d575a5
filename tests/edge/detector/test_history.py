"""The recent past is found by time, and forgotten where time is broken."""

import numpy as np

from edge.capture.frame import Picture
from edge.detector.history import History

T0 = 1_700_000_000 * 10**9


def test_past_is_found_by_time_not_by_index() -> None:
    history = History((0.1, 0.2))
    for k, t_ms in enumerate([0, 20, 45, 110, 140, 190, 230]):
        history.push(Picture(T0 + t_ms * 10**6, np.full((2, 2), k, np.uint8), "file"))
    assert [int(image[0, 0]) for image in history.past()] == [4, 1]  # 140 for 130, 20 for 30


def test_gap_and_step_back_forget_the_past() -> None:
    history = History((0.1, 0.2))
    image = np.zeros((2, 2), np.uint8)
    assert [history.push(Picture(T0 + t, image, "file")) for t in (0, 10**8, 3 * 10**9, 2 * 10**9)] == [
        False,
        False,
        True,
        True,
    ]
