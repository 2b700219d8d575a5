"""One number for each object of a picture, whatever its box calls it."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from calib.tracking.numbering import MOST_HEADS, REMEMBERED_S, PictureNumbers

SIGMA = np.ones(2)
APART = np.array([[200.0, 300.0], [900.0, 500.0]])  # px: two objects, far from each other


def numbers(labels: list[list[int]], rate_hz: float = 30.0, move_px_s: float = 300.0) -> np.ndarray:
    """(frames, 2) our numbers of two objects that move alike, under these labels of the box."""
    own, given_out = PictureNumbers(1000.0), []
    for k, label in enumerate(labels):
        pixels = APART + np.array([move_px_s * k / rate_hz, 0.0])
        given_out.append(own.number(np.array(label), pixels, SIGMA, k / rate_hz))
    return np.array(given_out)


def test_a_good_box_is_taken_at_its_word_however_far_its_objects_jump() -> None:
    """Hundreds of pixels a frame are no motion; the box that says so all the same saw what lies between."""
    found = numbers([[4, 9]] * 10, move_px_s=9000.0)
    assert (found == found[0]).all()
    assert found[0, 0] != found[0, 1]


def test_a_box_that_numbers_each_frame_anew_or_not_at_all_has_two_objects_too() -> None:
    for labels in ([[2 * k + 1, 2 * k + 2] for k in range(20)], [[0, 0]] * 20, [[3, 3]] * 20):
        for rate_hz in (3.0, 30.0):
            found = numbers(labels, rate_hz)
            assert (found == found[0]).all(), (labels[:2], rate_hz)
            assert found[0, 0] != found[0, 1]


def test_a_box_that_lost_its_number_on_the_way_goes_on_with_ours() -> None:
    found = numbers([[4, 9]] * 5 + [[4, 10]] * 5)
    assert (found == found[0]).all()


def test_two_objects_never_share_a_number_and_what_is_long_gone_gives_its_own_back_to_nobody() -> None:
    own = PictureNumbers(1000.0)
    first = own.number(np.array([1]), APART[:1], SIGMA[:1], 0.0)
    later = own.number(np.array([7]), APART[:1], SIGMA[:1], REMEMBERED_S + 0.1)
    assert first[0] != later[0]
    again = own.number(np.array([1, 7]), APART, SIGMA, REMEMBERED_S + 0.2)
    assert again[1] == later[0], "the box's word counts before the nearest"
    assert again[0] not in (first[0], later[0])


@given(
    st.lists(
        st.tuples(
            st.lists(st.tuples(st.integers(-3, 6), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)), max_size=6),
            st.floats(-0.2, 2.0),
        ),
        max_size=30,
    )
)
def test_whatever_comes_every_detection_has_a_number_of_its_own(frames: list[tuple[list, float]]) -> None:  # type: ignore[type-arg]
    own, t_s = PictureNumbers(1000.0), 0.0
    for rows, step_s in frames:
        t_s += step_s
        label = np.array([row[0] for row in rows], np.int64)
        pixels = np.array([row[1:] for row in rows], float).reshape(-1, 2)
        found = own.number(label, pixels, np.ones(len(rows)), t_s)
        assert len(set(found.tolist())) == len(rows)
        assert (found > 0).all()


def test_a_flood_of_objects_is_forgotten_oldest_first() -> None:
    own = PictureNumbers(1000.0)
    for k in range(3):
        pixels = np.random.default_rng(k).uniform(0, 1e6, (MOST_HEADS, 2))
        own.number(np.zeros(MOST_HEADS, np.int64), pixels, np.ones(MOST_HEADS), 0.01 * k)
    assert len(own.number(np.array([5]), APART[:1], SIGMA[:1], 0.04)) == 1
