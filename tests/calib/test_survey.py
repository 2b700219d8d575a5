"""Occupations to surveyed positions: antenna heights, comparison, combination, loop closure."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import CalibrationError
from calib.geodesy import enu_to_geodetic, geodetic_to_enu
from calib.survey import (
    MAX_APART_H_M,
    MAX_APART_V_M,
    Antenna,
    Occupation,
    apart,
    combine,
    loop_closure,
)
from edge.common.static_rtk import LEAST_STATIC_SIGMA_M

HERE = (48.0, 11.0, 500.0)
ANTENNA = Antenna(above_lens_m=0.25, measured_to="phase-centre")
START_NS = 1_790_000_000 * 10**9
MINUTE_NS = 60 * 10**9


def occupied(
    east: float = 0.0, north: float = 0.0, up: float = 0.0, *, minute: float = 0.0, **change: object
) -> Occupation:
    """An occupation of a tripod whose antenna is so far from HERE."""
    lat, lon, height = enu_to_geodetic(np.array([[east, north, up]]), HERE)[0].tolist()
    occupation = Occupation(
        t_unix_ns=START_NS + round(minute * MINUTE_NS),
        duration_s=180.0,
        samples=180,
        geodetic=(lat, lon, height),
        scatter_m=(0.004, 0.004, 0.010),
        floor_m=(0.006, 0.006, 0.015),
        fixed_m=(0.002, 0.002, 0.002),
        antenna=ANTENNA,
    )
    return replace(occupation, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("antenna", "up_m"),
    [
        (Antenna(0.25, "phase-centre"), 0.25),
        (Antenna(0.25, "ARP", phase_centre_above_arp_m=0.134), 0.384),
        (Antenna(0.25, "ARP", position_of="ARP"), 0.25),
        (Antenna(0.384, "phase-centre", position_of="ARP", phase_centre_above_arp_m=0.134), 0.25),
    ],
)
def test_the_lens_lies_below_what_the_coordinates_are_of(antenna: Antenna, up_m: float) -> None:
    assert antenna.up_m == pytest.approx(up_m)
    assert occupied(antenna=antenna).lens_geodetic[2] == pytest.approx(500.0 - up_m)


def test_an_antenna_that_cannot_be_allowed_for_is_refused() -> None:
    with pytest.raises(CalibrationError, match="data sheet"):
        Antenna(0.25, "ARP")
    with pytest.raises(CalibrationError, match="plumb line"):
        Antenna(0.25, "phase-centre", beside_lens_m=0.011)


def test_the_mean_is_weighed_by_length() -> None:
    point = combine([occupied(east=0.0), occupied(east=0.03, duration_s=90.0)], where="cam1")
    enu = geodetic_to_enu(np.array([point.geodetic]), occupied().lens_geodetic)[0]
    assert enu == pytest.approx([0.01, 0.0, 0.0], abs=1e-6)


def test_soon_after_the_slow_error_is_shared_and_later_it_is_halved() -> None:
    soon = combine([occupied(), occupied(minute=5)], where="cam1")
    later = combine([occupied(), occupied(minute=25)], where="cam1")
    assert (soon.independent, later.independent) == (1, 2)
    assert soon.sigma_m[0] == pytest.approx(math.sqrt(0.004**2 / 2 + 0.006**2 + 0.002**2))
    assert later.sigma_m[0] == pytest.approx(math.sqrt(0.004**2 / 2 + 0.006**2 / 2 + 0.002**2))


def test_sigma_has_a_floor() -> None:
    many = [occupied(minute=30 * i, fixed_m=(0.0, 0.0, 0.0)) for i in range(20)]
    assert combine(many, where="cam1").sigma_m == pytest.approx(LEAST_STATIC_SIGMA_M)


@pytest.mark.parametrize(
    ("offset", "fine"),
    [
        ((0.9 * MAX_APART_H_M, 0.0, 0.0), True),
        ((1.1 * MAX_APART_H_M, 0.0, 0.0), False),
        ((0.0, 0.0, 0.9 * MAX_APART_V_M), True),
        ((0.0, 0.0, -1.1 * MAX_APART_V_M), False),
    ],
)
def test_two_occupations_that_differ_are_not_combined(offset: tuple[float, float, float], fine: bool) -> None:
    both = [occupied(), occupied(*offset, minute=10)]
    assert apart(*both).too_far is not fine
    if fine:
        combine(both, where="cam1")
        return
    with pytest.raises(CalibrationError, match="false fix") as caught:
        combine(both, where="camera cam1")
    assert caught.value.where == "camera cam1"


def test_antennas_of_different_height_on_one_tripod_agree_about_the_lens() -> None:
    low = occupied(up=0.25)
    high = occupied(up=0.5, minute=10, antenna=Antenna(0.5, "phase-centre"))
    assert not apart(low, high).too_far
    assert abs(apart(low, high).vertical_m) < 1e-6


def test_the_loop_closes_or_does_not() -> None:
    assert loop_closure([occupied()]) is None
    closed = loop_closure([occupied(), occupied(0.01, minute=5), occupied(0.02, minute=60)])
    assert closed is not None
    assert (closed.apart.horizontal_m, closed.age_s) == (pytest.approx(0.02, abs=1e-6), pytest.approx(3600))
    assert "closes" in str(closed)
    broken = loop_closure([occupied(), occupied(0.2, minute=60)])
    assert broken is not None
    assert "moved" in str(broken)


def test_nothing_to_combine() -> None:
    with pytest.raises(CalibrationError):
        combine([], where="cam1")


@given(st.lists(st.tuples(st.floats(1, 600), st.floats(0, 300)), min_size=1, max_size=8))
def test_more_occupations_never_make_it_worse_than_the_worst_one(drawn: list[tuple[float, float]]) -> None:
    occupations = [occupied(duration_s=duration, minute=minute) for duration, minute in drawn]
    alone = combine(occupations[:1], where="x").sigma_m
    assert np.all(np.array(combine(occupations, where="x").sigma_m) <= np.array(alone) + 1e-12)
