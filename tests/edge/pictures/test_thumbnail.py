"""The operator's small picture: small whatever the camera, and a focus score that falls when the lens is turned."""

import cv2
import numpy as np
import pytest

from edge.pictures.thumbnail import THUMBNAIL_WIDTH_PX, focus_score, thumbnail


@pytest.mark.parametrize("shape", [(2160, 3840, 3), (720, 1280), (120, 160, 3), (2000, 10)])
def test_a_thumbnail_is_small_and_has_the_image_s_shape(shape: tuple[int, ...]) -> None:
    image = np.random.default_rng(0).integers(0, 255, shape, np.uint8)  # noise: the worst a JPEG can be given
    payload = thumbnail(image)
    seen = cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_COLOR)
    assert seen.shape[1] <= THUMBNAIL_WIDTH_PX
    assert seen.shape[0] / seen.shape[1] == pytest.approx(shape[0] / shape[1], rel=0.02)
    assert len(payload) < 60_000 * max(1.0, seen.shape[0] / seen.shape[1])


def test_a_blurred_picture_scores_lower() -> None:
    sharp = np.random.default_rng(0).integers(0, 255, (720, 1280, 3), np.uint8)
    scores = [focus_score(cv2.GaussianBlur(sharp, (0, 0), sigma)) for sigma in (0.5, 1.0, 2.0, 4.0)]
    assert focus_score(sharp) > scores[0]
    assert scores == sorted(scores, reverse=True)
