"""Fixes of one antenna, each beside those before: what contradicts is covered by sigma, what was seen is explained."""

import datetime as dt
import math

import numpy as np
import pytest
from msgspec.structs import replace

from edge.gnss.gates import metres_per_degree, offset_m
from edge.gnss.kept_fix import KeptFix
from edge.gnss.session import StaticSession
from edge.messages import Fix
from tools.doubles.receiver import Place, gga, rmc, rtk_error

PLACE = Place()
T0 = dt.datetime(2026, 6, 1, 12, tzinfo=dt.UTC)
FIX = Fix(
    t_unix_ns=int(T0.timestamp()) * 10**9, lat_deg=PLACE.lat_deg, lon_deg=PLACE.lon_deg, height_m=466.7, quality=4,
    sigma_m=(0.006, 0.006, 0.015), frame="EPSG:7931", samples=200, of="lens",
)  # fmt: skip


COVERED = 1.0001  # sigma; degrees are turned into metres about one place or about the other


def moved(fix: Fix, east_m: float, north_m: float, up_m: float, **said: object) -> Fix:
    """The same antenna, said to be elsewhere."""
    per_lon_m, per_lat_m = metres_per_degree(fix.lat_deg)
    place = {"lat_deg": fix.lat_deg + north_m / per_lat_m, "lon_deg": fix.lon_deg + east_m / per_lon_m}
    return replace(fix, height_m=fix.height_m + up_m, **place, **said)


def off_sigmas(used: Fix, claims: list[Fix]) -> float:
    """The largest miss of any claim by `used`, in its own 3-D sigma."""
    return max(math.hypot(*offset_m(used, claim)) for claim in claims) / math.hypot(*used.sigma_m)


def test_twenty_contradictions_are_each_covered_by_sigma_until_forgotten() -> None:
    rng = np.random.default_rng(19)
    for _ in range(20):
        kept, claims = KeptFix(), [FIX]
        assert kept.take(FIX) == FIX
        for _ in range(int(rng.integers(1, 4))):
            away = rng.normal(0, 10 ** rng.uniform(0, 2), 3)
            claims.append(moved(FIX, *away))
            used = kept.take(claims[-1])
            assert "beside" in kept.reason
            assert off_sigmas(used, claims) <= COVERED
        assert off_sigmas(kept.take(FIX), claims) <= COVERED  # coming back settles nothing
        kept.forget()
        assert kept.take(claims[-1]) == claims[-1]


def test_a_receiver_that_converges_or_wanders_as_real_ones_do_contradicts_nothing() -> None:
    rng = np.random.default_rng(20)
    for _ in range(20):
        error_m, kept = rtk_error(np.arange(1200.0), rng), KeptFix()
        for seconds in range(30, 1200, 30):
            mean = error_m[max(0, seconds - 600) : seconds].mean(axis=0)
            sigma = np.hypot((0.008, 0.008, 0.02), np.array((0.01, 0.01, 0.025)) * math.sqrt(40 / min(seconds, 600)))
            fix = moved(FIX, *mean, sigma_m=tuple(sigma.tolist()), samples=seconds)
            assert kept.take(fix) == fix, kept.reason


def test_a_first_fix_too_short_to_accuse_another_is_replaced() -> None:
    kept, later = KeptFix(), moved(FIX, 0.4, 0.0, 0.2)
    kept.take(replace(FIX, samples=8))
    assert (kept.take(later), kept.take(later), kept.reason) == (later, later, "")


def test_another_point_or_frame_is_not_compared() -> None:
    for other in ({"of": "antenna"}, {"frame": "EPSG:9989"}):
        kept, next_fix = KeptFix(), moved(FIX, 0.0, 0.0, 1.5, **other)
        kept.take(FIX)
        assert (kept.take(next_fix), kept.reason) == (next_fix, "")


def carried(session: StaticSession, way_m: list[float], second: float) -> float:
    """One epoch a second at each distance east, with millimetres of noise; the second after."""
    for k, east_m in enumerate(way_m):
        error_m = np.array([east_m + 0.002 * (k % 3), 0.001 * (k % 2), 0.0])
        t = T0 + dt.timedelta(seconds=second)
        session.feed(gga(t, PLACE, error_m) + rmc(t), second)
        second += 1.0
    return second


@pytest.mark.parametrize("step_m", [0.2, 0.5, 1.0, 1.7])
def test_a_tripod_that_was_seen_carried_is_believed_where_it_stands_after_a_minute(step_m: float) -> None:
    session = StaticSession()
    at = carried(session, [0.0] * 120, 0.0)
    at = carried(session, list(np.arange(step_m, 35.0, step_m)), at)
    at = carried(session, [35.0] * 30, at)
    surveyed = session.surveyed()
    assert surveyed is not None
    assert "carried" in surveyed.mean.fault
    carried(session, [35.0] * 60, at)
    surveyed = session.surveyed()
    assert surveyed is not None
    assert (surveyed.mean.fault, session.moves) == ("", 1)
    east_m = (surveyed.lon_deg - PLACE.lon_deg) * metres_per_degree(PLACE.lat_deg)[0]
    assert east_m == pytest.approx(35.0, abs=0.01)


@pytest.mark.parametrize("jump_m", [0.3, 1.3, 35.0])
def test_a_jump_is_not_taken_for_a_walk(jump_m: float) -> None:
    session = StaticSession()
    carried(session, [jump_m] * 60, carried(session, [0.0] * 120, 0.0))
    surveyed = session.surveyed()
    assert surveyed is not None
    assert "away" in surveyed.mean.fault
    assert session.moves == 0
