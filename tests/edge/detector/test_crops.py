"""Crops lie in the frame, hold what they were cut for, and give back its place."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.detector.crops import SIDE_PX, choose, cut, in_frame
from edge.detector.detections import Detections


@given(
    u=st.floats(-20, 1940),
    v=st.floats(-20, 1100),
    extent=st.floats(1, 300),
    size=st.tuples(st.integers(64, 1920), st.integers(64, 1080)),
)
def test_crops_lie_in_the_frame_and_hold_their_region(u: float, v: float, extent: float, size: tuple[int, int]) -> None:
    (crop,) = choose(np.array([[u, v, extent]]), size, 4)
    assert crop.left >= 0
    assert crop.top >= 0
    for at, low, length in ((u, crop.left, size[0]), (v, crop.top, size[1])):
        if crop.side_px <= length:
            assert low + crop.side_px <= length
        if 0 <= at <= length - 1:
            assert low <= at <= low + crop.side_px


def test_crop_coordinates_invert_reduction() -> None:
    image = np.zeros((512, 512), np.uint8)
    image[200:204, 300:304] = 255  # centre at 301.5, 201.5
    (crop,) = choose(np.array([[301.5, 201.5, 100.0]]), (512, 512), 1)
    assert crop.reduction == 4
    piece = cut([image], [crop])[0, :, :, 0].astype(float)
    assert piece.shape == (SIDE_PX, SIDE_PX)
    v, u = np.indices(piece.shape)
    centre = np.array([[(piece * u).sum(), (piece * v).sum()]]) / piece.sum()
    one = np.ones(1)
    found = Detections(centre, np.full((1, 2), 1.0), one, one, np.ones((1, 1)))
    back = in_frame(found, [crop], np.zeros(1, np.intp), (512, 512))
    assert back.centre_px[0] == pytest.approx((301.5, 201.5), abs=1e-6)
    assert back.size_px[0] == pytest.approx((4.0, 4.0))
