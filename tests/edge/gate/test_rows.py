"""Rows between two looks lie on the line between them, and say that they were never measured."""

import numpy as np
import pytest

from edge.detector.detections import Detections
from edge.gate.rows import TrackRow, interpolate, rows_of

T0 = 1_700_000_000 * 10**9
MS = 10**6


def test_rows_between_are_on_the_line_and_marked() -> None:
    before = TrackRow(T0, 3, 10.0, 20.0, 4.0, 4.0, 0.9, "confirmed", 0.5, (0.1, 0.8))
    after = TrackRow(T0 + 100 * MS, 3, 20.0, 0.0, 8.0, 4.0, 0.6, "confirmed", 0.5, (0.2, 0.7))
    (row,) = interpolate(before, after, [T0 + 25 * MS])
    assert (row.u_px, row.v_px, row.width_px, row.height_px) == pytest.approx((12.5, 15.0, 5.0, 4.0))
    assert (row.track, row.status, row.sigma_px, row.score) == (3, "interpolated", None, 0.6)
    assert row.classes == after.classes
    assert interpolate(before, after, []) == []


def test_a_detector_that_knows_no_sigma_gives_none() -> None:
    two = np.array([[1.0, 2.0], [3.0, 4.0]])
    found = Detections(two, two, np.array([0.5, 0.6]), np.array([np.nan, 0.4]), np.array([[0.5], [0.6]]))
    first, second = rows_of(T0, found)
    assert (first.sigma_px, second.sigma_px) == (None, 0.4)
    assert (second.u_px, second.height_px, second.classes, second.track) == (3.0, 4.0, (0.6,), 0)
