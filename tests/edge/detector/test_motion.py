"""What moves is proposed; what always moves is learnt, and a whole picture that moves proposes nothing."""

import numpy as np
import pytest

from edge.detector.motion import MotionDetector
from tests.edge.footage import sky

SIZE = (320, 240)


def test_motion_learns_what_always_moves_and_still_sees_what_is_new() -> None:
    rng = np.random.default_rng(6)
    motion = MotionDetector()
    images = []
    for k in range(200):
        image = sky(SIZE, [(40 + 60 * (k - 180) / 30, 60.0)] if k >= 180 else [], rng)
        image[150:] = rng.integers(0, 255, (90, 320), np.uint8)  # a wood in a gale
        images.append(image)
        if k >= 6:
            blobs = motion.propose(image, [images[-4], images[-7]], 1 / 30)
    assert len(blobs.strength)
    assert blobs.centre_px[0] == pytest.approx((40 + 60 * 19 / 30, 60.0), abs=4)
    assert np.all(blobs.centre_px[:, 1] < 150) or np.mean(blobs.centre_px[:, 1] < 150) > 0.5


def test_everything_moving_proposes_nothing() -> None:
    rng = np.random.default_rng(6)
    motion = MotionDetector()
    still = sky(SIZE, [], rng)
    motion.propose(still, [still, still], 0.03)
    blobs = motion.propose(rng.integers(0, 255, still.shape, np.uint8), [still, still], 0.03)
    assert blobs.share > 0.5
    assert not len(blobs.strength)
