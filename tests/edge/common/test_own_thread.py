"""Threads of one process share one interpreter: how long one keeps the others waiting is ours to say."""

import sys

import pytest

from edge.common.own_thread import GIVE_WAY_S, give_way_soon


def test_a_program_has_its_threads_give_way_sooner_than_python_does() -> None:
    before = sys.getswitchinterval()
    try:
        give_way_soon()
        assert sys.getswitchinterval() == pytest.approx(GIVE_WAY_S)
        assert GIVE_WAY_S < 0.005, "Python's own"
    finally:
        sys.setswitchinterval(before)
