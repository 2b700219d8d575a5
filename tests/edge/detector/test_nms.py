"""Suppression keeps close neighbours apart and duplicates out."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edge.detector.nms import MAX_CANDIDATES, suppress


def test_two_small_boxes_close_together_both_stay() -> None:
    # A routine that takes corners for sizes deletes the second of these, 40 px away.
    centre = np.array([[600.0, 400.0], [640.0, 400.0], [606.0, 400.0]])
    size = np.full((3, 2), 10.0)
    assert suppress(centre, size, np.array([0.9, 0.8, 0.7]), 0.45).tolist() == [0, 1, 2]


def test_duplicate_goes_and_the_better_one_stays() -> None:
    centre = np.array([[100.0, 100.0], [101.0, 100.0]])
    assert suppress(centre, np.full((2, 2), 10.0), np.array([0.5, 0.9]), 0.45).tolist() == [1]


def test_nothing_in_nothing_out() -> None:
    assert suppress(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), 0.45).size == 0


@given(st.lists(st.tuples(*[st.floats(0, 200)] * 2, *[st.floats(1, 50)] * 2, st.floats(0, 1)), max_size=30))
def test_no_two_kept_boxes_overlap_and_every_dropped_one_does(boxes: list[tuple[float, ...]]) -> None:
    table = np.array(boxes).reshape(-1, 5)
    centre, size, score = table[:, :2], table[:, 2:4], table[:, 4]
    keep = suppress(centre, size, score, 0.3)
    for k in range(len(table)):
        overlaps = [iou(table[k], table[other]) > 0.3 + 1e-9 for other in keep if other != k]
        if k in keep:
            assert not any(overlaps)
        else:
            assert any(iou(table[k], table[other]) > 0.3 - 1e-9 for other in keep)


def test_work_is_bounded() -> None:
    rng = np.random.default_rng(1)
    centre = rng.uniform(0, 1e5, (5000, 2))
    assert len(suppress(centre, np.full((5000, 2), 4.0), rng.uniform(size=5000), 0.45)) <= MAX_CANDIDATES


def iou(a: np.ndarray, b: np.ndarray) -> float:
    low = np.maximum(a[:2] - a[2:4] / 2, b[:2] - b[2:4] / 2)
    high = np.minimum(a[:2] + a[2:4] / 2, b[:2] + b[2:4] / 2)
    shared = np.prod(np.maximum(high - low, 0))
    return float(shared / (np.prod(a[2:4]) + np.prod(b[2:4]) - shared))
