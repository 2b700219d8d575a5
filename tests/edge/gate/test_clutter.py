"""Where false tracks keep appearing is learnt, and forgotten again."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.gate.clutter import CLUTTER_CELL_PX, FORGET_S, FULL, ClutterMap

SIZE = (640, 480)
T0 = 1_700_000_000 * 10**9


def test_a_place_is_cluttered_after_several_entries_and_its_neighbours_half() -> None:
    clutter = ClutterMap(SIZE)
    for _ in range(int(FULL)):
        clutter.add(320.0, 240.0, T0)
    assert clutter.level(320.0, 240.0) == 1.0
    assert clutter.level(320.0 + CLUTTER_CELL_PX, 240.0) == pytest.approx(0.5)
    assert clutter.level(320.0 + 3 * CLUTTER_CELL_PX, 240.0) == 0.0


def test_it_is_forgotten_with_its_time_constant_and_time_set_back_forgets_nothing() -> None:
    clutter = ClutterMap(SIZE)
    clutter.add(100.0, 100.0, T0)
    before = clutter.level(100.0, 100.0)
    clutter.add(500.0, 400.0, T0 + round(FORGET_S * 1e9))
    assert clutter.level(100.0, 100.0) == pytest.approx(before / math.e)
    clutter.add(500.0, 400.0, T0)
    assert clutter.level(100.0, 100.0) == pytest.approx(before / math.e)


@given(u=st.floats(-1e4, 1e4), v=st.floats(-1e4, 1e4))
def test_any_place_may_be_asked_for(u: float, v: float) -> None:
    clutter = ClutterMap(SIZE)
    clutter.add(u, v, T0)
    assert 0 < clutter.level(u, v) <= 1
