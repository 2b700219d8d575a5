"""A position's covariance where the distance is uncertain: wide enough along the sight, and no direction made sure."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.adjustment.uncertainty import SURE_SIGMAS, curved

MIDDLE = np.array([5.0, -3.0, 1.0])


@given(seed=st.integers(0, 2**32 - 1), longest_m=st.floats(0.1, 300.0))
def test_nothing_becomes_surer_than_the_tangent_has_it(seed, longest_m):
    """One of three heights above sea level leaves a tilt open, which is no line of sight: the ellipsoid was turned away
    from it, and every true position then lay beside a needle."""
    random = np.random.default_rng(seed)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    covariance = (axes * np.array([0.1, 0.3, longest_m]) ** 2) @ axes.T
    points = MIDDLE + random.normal(size=(4, 3)) * 40
    added = curved(np.broadcast_to(covariance, (4, 3, 3)), points, MIDDLE) - covariance
    # rounding alone may take a part in 1e12 of the largest variance away
    assert np.linalg.eigvalsh(added).min() > -1e-9 * longest_m**2 * 400


def test_the_distance_reaches_as_far_as_its_inverse_may():
    """A tenth of the distance at one sigma: at four its inverse is six tenths, the distance beyond by two thirds."""
    sight = np.array([0.0, 0.6, 0.8])
    covariance = 10.0**2 * np.outer(sight, sight) + 0.1**2 * np.eye(3)
    wide = curved(covariance[None], (MIDDLE + 100 * sight)[None], MIDDLE)[0]
    sigma = np.sqrt(sight @ wide @ sight)
    assert SURE_SIGMAS * sigma / 100 == pytest.approx(2 / 3, rel=1e-3)  # the decimetre added to the ten metres
    across = np.array([1.0, 0.0, 0.0])
    assert across @ wide @ across == pytest.approx(0.1**2)
