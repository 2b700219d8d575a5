"""Which epochs are believed: each reason for a refusal, and what stands still."""

import datetime as dt
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.gnss.decoders import nmea, ubx
from edge.gnss.decoders.nmea import Gga, Gst, Rmc
from edge.gnss.decoders.ubx import HighPrecision, Pvt
from edge.gnss.diagnosis import ADVICE
from edge.gnss.epoch import Epoch
from edge.gnss.gates import (
    CONFIRMATIONS,
    MAX_STEP_H_M,
    MAX_STEP_V_M,
    Policy,
    Position,
    Reason,
    Refusal,
    StillnessGate,
    elapsed_ms,
    judge,
    metres_per_degree,
    offset_m,
)
from edge.gnss.geoid import undulation_m

GGA = Gga(43_200_000, 48.0, 11.0, 4, 12, 500.0, 47.0, 1.0, "", 7, 3)
PVT = Pvt(43_200_000, 77_000, dt.date(2026, 6, 1), True, 4, 20, 48.0, 11.0, 547.0, 1.0)
PRECISE = HighPrecision(77_000, 48.0, 11.0, 547.0, (0.01, 0.02))
NEWEST = Policy(earliest=dt.date(2025, 1, 1))


def epoch(t_day_ms: int = 43_200_000, *, pdops: tuple[float, ...] = (), **records: object) -> Epoch:
    """An epoch, at noon unless said otherwise, of what messages said."""
    made = Epoch(t_day_ms, pdops=list(pdops))
    for record in records.values():
        made.add(ubx.part(record) if isinstance(record, Pvt | HighPrecision) else nmea.part(record))  # type: ignore[arg-type]
    return made


def test_a_good_epoch() -> None:
    position = judge(epoch(gga=GGA), Policy())
    assert isinstance(position, Position)
    assert (position.height_m, position.source) == (547.0, "GGA")


@pytest.mark.parametrize(
    ("parts", "policy", "reason"),
    [
        *[({"gga": replace(GGA, quality=quality)}, Policy(), Reason.QUALITY) for quality in (0, 1, 2, 3, 5, 6, 7, 8)],
        ({"gga": GGA, "pvt": replace(PVT, quality=5)}, Policy(), Reason.QUALITY),
        ({"gga": GGA, "rmc": Rmc(43_200_000, True, None, "F")}, Policy(), Reason.QUALITY),
        ({"gga": GGA, "rmc": Rmc(43_200_000, False, None, "R")}, Policy(), Reason.QUALITY),
        ({"gst": Gst(43_200_000, (0.01, 0.01, 0.01))}, Policy(), Reason.NO_POSITION),
        ({"gga": replace(GGA, lat_deg=None)}, Policy(), Reason.NO_POSITION),
        ({"gga": replace(GGA, age_s=5.1)}, Policy(), Reason.AGE),
        ({"gga": replace(GGA, age_s=-1.0)}, Policy(), Reason.AGE),
        ({"gga": GGA, "pvt": replace(PVT, age_s=10.0)}, Policy(), Reason.AGE),
        ({"gga": replace(GGA, age_s=None)}, Policy(), Reason.AGE_UNKNOWN),
        ({"gga": replace(GGA, decimals=5)}, Policy(), Reason.RESOLUTION),
        ({"pvt": PVT}, Policy(), Reason.RESOLUTION),
        ({"gga": replace(GGA, separation_m=None)}, Policy(), Reason.SEPARATION),
        ({"gga": replace(GGA, lat_deg=0.0, lon_deg=0.0)}, Policy(), Reason.RANGE),
        ({"gga": replace(GGA, altitude_m=99999.0)}, Policy(), Reason.RANGE),
        ({"gga": GGA, "gst": Gst(43_200_000, (0.01, 0.2, 0.01))}, Policy(), Reason.DOUBT),
        ({"gga": GGA, "pdops": [6.5, 6.5]}, Policy(), Reason.GEOMETRY),
        ({"gga": GGA, "rmc": Rmc(43_200_000, True, dt.date(2007, 1, 1), "R")}, NEWEST, Reason.DATE),
        (
            {"gga": replace(GGA, lat_deg=48.000001), "pvt": PVT, "high_precision": PRECISE},
            Policy(),
            Reason.DISAGREE,
        ),
    ],
)
def test_each_reason(parts: dict[str, object], policy: Policy, reason: Reason) -> None:
    refusal = judge(epoch(**parts), policy)
    assert isinstance(refusal, Refusal)
    assert refusal.reason is reason
    assert str(refusal)


def test_every_reason_has_a_next_action() -> None:
    assert set(ADVICE) == set(Reason)


def test_a_leap_second() -> None:
    assert judge(epoch(86_400_000, gga=GGA), Policy()) == Refusal(Reason.LEAP_SECOND)


def test_what_the_operator_may_allow() -> None:
    blank = epoch(gga=replace(GGA, separation_m=None, age_s=None))
    position = judge(blank, Policy(separation_m=38.0, accept_unknown_age=True))
    assert isinstance(position, Position)
    assert position.height_m == 538.0


@pytest.mark.parametrize("sent_m", [None, 0.0, 47.0, -47.0, 12.0])
def test_an_explicit_separation_is_used_whatever_the_receiver_sends(sent_m: float | None) -> None:
    position = judge(epoch(gga=replace(GGA, separation_m=sent_m)), Policy(separation_m=47.2))
    assert isinstance(position, Position)
    assert position.height_m == pytest.approx(547.2)


def test_an_explicit_separation_leaves_heights_above_the_ellipsoid_alone() -> None:
    position = judge(epoch(gga=GGA, pvt=PVT, high_precision=PRECISE), Policy(separation_m=47.0))
    assert isinstance(position, Position)
    assert (position.height_m, position.source) == (547.0, "NAV-HPPOSLLH")


def places(seed: int, count: int) -> list[tuple[float, float]]:
    """Places all over the Earth."""
    rng = np.random.default_rng(seed)
    return list(zip(np.degrees(np.arcsin(rng.uniform(-1, 1, count))), rng.uniform(-180, 180, count), strict=True))


@pytest.mark.parametrize("lie", ["zero", "sign", "other site"])
def test_a_separation_that_cannot_be_right_is_refused_by_name_anywhere_on_earth(lie: str) -> None:
    refused = 0
    for lat_deg, lon_deg in places(2, 60):
        known_m = undulation_m(lat_deg, lon_deg)
        sent_m = {"zero": 0.0, "sign": -known_m, "other site": known_m + math.copysign(15.0, -known_m)}[lie]
        if abs(sent_m - known_m) < 4.0:
            continue
        verdict = judge(epoch(gga=replace(GGA, lat_deg=lat_deg, lon_deg=lon_deg, separation_m=sent_m)), Policy())
        assert isinstance(verdict, Refusal)
        assert verdict.reason is Reason.GEOID
        assert "EGM96" in verdict.detail
        refused += 1
    assert refused > 40


def test_a_receivers_own_coarse_table_is_no_contradiction() -> None:
    for lat_deg, lon_deg in places(3, 60):
        known_m = undulation_m(lat_deg, lon_deg)
        for off_m in (-5.3, -1.0, 0.4, 5.0):  # 5.3 m: what a u-blox F9P in data/nmea says
            sent_m = known_m + off_m
            if abs(sent_m + known_m) < 1.5:
                continue  # near a zero of the geoid such an error looks like a wrong sign
            gga = replace(GGA, lat_deg=lat_deg, lon_deg=lon_deg, separation_m=sent_m)
            assert isinstance(judge(epoch(gga=gga), Policy()), Position)


def test_the_sites_own_geoid_is_a_witness_too() -> None:
    at_sea = replace(GGA, lat_deg=undulation_zero(), lon_deg=0.0)
    assert isinstance(judge(epoch(gga=replace(at_sea, separation_m=0.0)), Policy()), Position)
    verdict = judge(epoch(gga=replace(at_sea, separation_m=0.0)), Policy(undulation_m=1.2))
    assert isinstance(verdict, Refusal)
    assert "site.undulation_m" in verdict.detail


def undulation_zero() -> float:
    """A latitude on the meridian of Greenwich where the geoid meets the ellipsoid, to a metre."""
    return min((abs(undulation_m(lat_deg, 0.0)), lat_deg) for lat_deg in np.arange(-80.0, 80.0, 0.05).tolist())[1]


def test_the_precise_position_is_preferred() -> None:
    position = judge(epoch(gga=GGA, pvt=PVT, high_precision=PRECISE), Policy())
    assert isinstance(position, Position)
    assert position.source == "NAV-HPPOSLLH"


def test_an_rmc_of_an_old_receiver_contradicts_nothing() -> None:
    for mode in ("", "R", "D", "A", "P"):
        assert isinstance(judge(epoch(gga=GGA, rmc=Rmc(43_200_000, True, None, mode)), Policy()), Position)


def at(second: float, east_m: float = 0.0, north_m: float = 0.0, up_m: float = 0.0) -> Position:
    """A position so far from the first, so many seconds after noon."""
    per_lon, per_lat = metres_per_degree(48.0)
    t_day_ms = round(43_200_000 + second * 1000) % 86_400_000
    return Position(t_day_ms, None, 48.0 + north_m / per_lat, 11.0 + east_m / per_lon, 547.0 + up_m, (0.0, 0.0), "GGA")


def settled() -> StillnessGate:
    """A gate that has accepted positions at seconds 0 to 4."""
    gate = StillnessGate()
    accepted = [position for second in range(5) for position in gate.judge(at(second)).accepted]
    assert len(accepted) == 5
    return gate


def test_the_first_epochs_wait_for_each_other() -> None:
    gate = StillnessGate()
    counts = [len(gate.judge(at(second)).accepted) for second in range(5)]
    assert counts == [0] * (CONFIRMATIONS - 1) + [CONFIRMATIONS] + [1] * (5 - CONFIRMATIONS)


def test_a_wrong_epoch_at_the_very_beginning_is_not_believed() -> None:
    gate = StillnessGate()
    accepted = [p for p in (at(0, 100.0), at(1), at(2), at(3)) for p in gate.judge(p).accepted]
    assert [offset_m(position, at(0))[0] for position in accepted] == pytest.approx([0.0] * 3)


@pytest.mark.parametrize(
    ("position", "reason"),
    [
        (at(5, 0.9 * MAX_STEP_H_M), None),
        (at(5, 1.1 * MAX_STEP_H_M), Reason.JUMP),
        (at(5, 0.8 * MAX_STEP_H_M, 0.8 * MAX_STEP_H_M), Reason.JUMP),
        (at(5, up_m=0.9 * MAX_STEP_V_M), None),
        (at(5, up_m=-1.1 * MAX_STEP_V_M), Reason.JUMP),
        (at(4), Reason.TIME_ORDER),
        (at(3.5), Reason.TIME_ORDER),
        (at(-3600), Reason.TIME_ORDER),
        (at(15), Reason.UNCONFIRMED),
    ],
)
def test_the_next_must_follow(position: Position, reason: Reason | None) -> None:
    refusal = settled().judge(position).refusal
    assert (refusal.reason if refusal else None) is reason


def test_one_outlier_does_not_break_the_chain() -> None:
    gate = settled()
    assert gate.judge(at(5, 50.0)).refusal
    assert gate.judge(at(6)).accepted == (at(6),)
    assert gate.segment == 1


def test_a_wrong_time_locks_nobody_out() -> None:
    gate = settled()
    assert gate.judge(at(3600)).refusal
    assert gate.judge(at(5)).accepted == (at(5),)


def test_a_clock_that_is_set_back_begins_a_new_segment() -> None:
    gate = settled()
    accepted = [p for second in (-18, -17, -16, -15) for p in gate.judge(at(second)).accepted]
    assert len(accepted) == 4
    assert gate.segment == 2


def test_what_moves_is_never_accepted() -> None:
    gate = StillnessGate()
    assert not any(gate.judge(at(second / 4, second * 0.35)).accepted for second in range(100))


def test_midnight_is_no_step_back() -> None:
    assert elapsed_ms(500, 86_399_500) == 1000
    assert elapsed_ms(86_399_500, 500) == -1000
    gate = StillnessGate()
    accepted = [p for second in range(43195, 43206) for p in gate.judge(at(second)).accepted]
    assert len(accepted) == 11


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=40))
def test_nothing_accepted_in_a_chain_is_far_from_those_before(offsets: list[tuple[float, float, float]]) -> None:
    gate = StillnessGate()
    last: tuple[int, Position] | None = None
    for second, offset in enumerate(offsets):
        verdict = gate.judge(at(second, *offset))
        for position in verdict.accepted:
            if last and last[0] == verdict.segment:
                east, north, up = offset_m(position, last[1])
                # The limits hold against the median of the last five, and those lie within the limits themselves.
                assert math.hypot(east, north) < 4 * MAX_STEP_H_M
                assert abs(up) < 4 * MAX_STEP_V_M
            last = (verdict.segment, position)


def test_metres_per_degree_at_the_equator_and_the_pole() -> None:
    # Meridian radii of curvature there: b^2/a and a^2/b; the equator is a circle of radius a.
    assert metres_per_degree(0.0) == pytest.approx((111319.4908, 110574.2758), abs=1e-3)
    assert metres_per_degree(90.0) == pytest.approx((0.0, 111693.9800), abs=1e-3)
