"""Into a model's input and back: no pixel moves, whatever the two sizes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.detector.letterbox import PAD_VALUE, Letterbox


def test_a_wide_frame_is_padded_above_and_below() -> None:
    image = np.full((50, 100), 7, np.uint8)
    out = Letterbox((100, 50), (200, 200)).apply(image)
    assert out.shape == (200, 200)
    assert set(np.unique(out[:50])) == set(np.unique(out[150:])) == {PAD_VALUE}
    assert np.all(out[50:150] == 7)


def test_a_frame_of_the_inputs_size_is_not_copied() -> None:
    image = np.zeros((64, 32, 3), np.uint8)
    assert Letterbox((32, 64), (32, 64)).apply(image) is image


@given(
    frame=st.tuples(st.integers(16, 4000), st.integers(16, 4000)),
    size=st.tuples(st.integers(32, 1300), st.integers(32, 1300)),
    at=st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
def test_letterbox_inverts_itself(frame: tuple[int, int], size: tuple[int, int], at: tuple[float, float]) -> None:
    box = Letterbox(frame, size)
    if min(box.inner_px) < 1:
        return
    share = np.array([at])
    corner = share * box.inner_px + box.offset_px
    assert box.to_frame_px(corner)[0] == pytest.approx(np.array(at) * frame - 0.5, abs=1e-6 * max(frame))
    assert box.inner_px[0] <= size[0]
    assert box.inner_px[1] <= size[1]
