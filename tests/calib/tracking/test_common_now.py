"""What "now" is: one camera moves it by no more than another confirms."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from calib.observations import Frame
from calib.tracking.common_now import ALONE_S, GONE_S, MOST_WAITING, CommonNow


def frame(camera: str = "cam0") -> Frame:
    none = np.zeros(0)
    return Frame(camera, 0, np.zeros((0, 2)), np.zeros(0, np.int64), none, none)


def test_of_one_camera_it_is_that_cameras() -> None:
    common = CommonNow()
    assert common.now_s == -math.inf
    common.note("cam0", 5.0)
    assert common.now_s == 5.0
    common.note("cam0", 5.1)
    assert common.now_s == 5.1


@given(
    times=st.lists(st.floats(0, 100), min_size=4, max_size=40),
    ahead_s=st.floats(0.0, 0.9 * GONE_S),
    others=st.integers(2, 5),
)
def test_one_camera_ahead_does_not_move_it(times: list[float], ahead_s: float, others: int) -> None:
    """Whatever it says, now is never later than the latest of the others."""
    common, latest = CommonNow(), -math.inf
    for number, t_s in enumerate(sorted(times)):
        latest = t_s
        common.note(f"cam{number % others}", t_s)
        if number >= others:
            common.note("liar", t_s + ahead_s)
            assert common.now_s <= latest


def test_a_camera_leads_while_no_other_has_come_as_far() -> None:
    common = CommonNow()
    for camera in ("cam0", "cam1", "cam2"):
        common.note(camera, 1.0)
    common.note("cam0", 2.0)
    assert (common.leads("cam0", 0.5), common.leads("cam1", 0.5), common.leads("who", 0.5)) == (True, False, False)
    common.note("cam1", 1.9)
    assert not common.leads("cam0", 0.5)


def test_those_who_are_gone_confirm_nothing_and_hold_nobody_up() -> None:
    common = CommonNow()
    for camera in ("cam0", "cam1", "cam2"):
        common.note(camera, 1.0)
    common.note("cam0", 1.0 + GONE_S - 0.1)
    assert common.now_s == 1.0
    common.note("cam0", 1.0 + GONE_S + 0.1)
    assert common.now_s == 1.0 + GONE_S + 0.1


def test_the_last_that_speaks_is_followed_after_a_second_and_the_others_count_again_when_they_come_back() -> None:
    common, fps = CommonNow(), 25
    for camera in ("cam0", "cam1", "cam2"):
        common.note(camera, 1.0)
    for number in range(1, 2 * fps):
        common.note("cam0", 1.0 + number / fps)
        alone = number / fps > ALONE_S + 1.5 / fps
        assert common.now_s == 1.0 or number / fps > ALONE_S
        assert common.now_s == 1.0 + number / fps or not alone
    common.note("cam1", 3.0)
    common.note("cam0", 4.0)
    assert common.now_s == 3.0


def test_a_camera_in_a_hurry_is_not_alone() -> None:
    """Twenty frames of one between two of others are a burst, however far apart they say they were taken."""
    common = CommonNow()
    for number in range(20):
        common.note("cam0", number / 30)
        common.note("cam1", number / 30)
        for ahead in range(20):
            common.note("liar", number / 30 + 0.1 * ahead)
        assert common.now_s <= (number + 1) / 30


def test_what_waits_comes_in_the_order_it_came_and_once() -> None:
    common = CommonNow()
    first, second, third = frame("a"), frame("b"), frame("c")
    for held, t_s in ((first, 3.0), (second, 2.0), (third, 9.0)):
        assert common.hold(held, t_s)
    assert [f.camera for f in common.due(3.0)] == ["a", "b"]
    assert common.due(3.0) == []
    common.shift(-5.0)
    assert [f.camera for f in common.due(4.0)] == ["c"]


def test_what_waits_is_bounded() -> None:
    common = CommonNow()
    kept = [common.hold(frame(), float(number)) for number in range(MOST_WAITING + 3)]
    assert kept.count(False) == 3
    assert len(common.due(math.inf)) == MOST_WAITING
