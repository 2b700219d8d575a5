"""Enlarged and back: a place stays where it was, and a size is what it was."""

import numpy as np
import pytest

from edge.detector.detections import Detections
from edge.detector.magnify import MAGNIFIED, enlarged, reduced


def test_what_is_found_enlarged_is_told_in_the_pictures_own_pixels() -> None:
    image = np.zeros((40, 60), np.uint8)
    image[20, 30] = 255
    larger = enlarged(image).astype(float)
    assert larger.shape == (40 * MAGNIFIED, 60 * MAGNIFIED)
    v, u = np.indices(larger.shape)
    centre = np.array([[(larger * u).sum(), (larger * v).sum()]]) / larger.sum()
    found = Detections(centre, np.array([[4.0, 6.0]]), np.array([0.9]), np.array([1.0]), np.array([[0.9]]))
    back = reduced(found)
    # Rounding to grey levels moves the middle of one bright pixel by less than a hundredth.
    assert back.centre_px[0] == pytest.approx((30.0, 20.0), abs=0.01)
    assert back.size_px[0] == pytest.approx((2.0, 3.0))
    assert (back.score[0], back.sigma_px[0]) == (0.9, 0.5)
