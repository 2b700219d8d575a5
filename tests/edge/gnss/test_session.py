"""Bytes to positions in one go, on streams made here and on real recordings."""

import datetime as dt
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge.gnss.averaging import SERVICES
from edge.gnss.diagnosis import ReceiverState, Watch, diagnose
from edge.gnss.gates import Policy, Position, Reason, offset_m
from edge.gnss.session import STATIC_WINDOW_S, StaticSession, t_unix_ns
from tests.places import DATA
from tools.doubles.receiver import Place, gga, gst, rmc, rtk_error, zda

RECORDINGS = DATA / "nmea"
T0 = dt.datetime(2026, 6, 1, 12, 0, 0, tzinfo=dt.UTC)
PLACE = Place()

needs_recordings = pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"the recordings are not at {RECORDINGS}")


def second(count: float) -> dt.datetime:
    """So many seconds after the beginning."""
    return T0 + dt.timedelta(seconds=count)


def played(stream: Iterable[bytes], session: StaticSession | None = None) -> tuple[StaticSession, list[Position]]:
    """A session fed with pieces a second apart, and what it accepted."""
    session = session or StaticSession()
    accepted: list[Position] = []
    t_s = 0.0
    for t_s, piece in enumerate(stream):
        accepted += session.feed(piece, float(t_s))
    return session, accepted + session.interrupt(t_s + 1.0)


def still(count: int, start: int = 0, **fields: object) -> list[bytes]:
    """GGA, RMC and GST of an antenna at rest, a second apart."""
    times = [second(start + i) for i in range(count)]
    return [gga(t, PLACE, **fields) + rmc(t) + gst(t) for t in times]  # type: ignore[arg-type]


def test_a_minute_of_a_good_receiver() -> None:
    error = rtk_error(np.arange(60.0), np.random.default_rng(1))
    session, accepted = played(gga(second(i), PLACE, e) + rmc(second(i)) for i, e in enumerate(error))
    surveyed = session.surveyed()
    assert len(accepted) == 60
    assert surveyed is not None
    assert not surveyed.mean.fault
    truth = Position(0, None, PLACE.lat_deg, PLACE.lon_deg, PLACE.altitude_m + PLACE.separation_m, (0, 0), "truth")
    there = Position(0, None, surveyed.lat_deg, surveyed.lon_deg, surveyed.height_m, (0, 0), "surveyed")
    # Four sigma: one seed in sixteen thousand.
    assert np.all(np.abs(offset_m(there, truth)) < 4 * surveyed.mean.sigma_m)
    assert t_unix_ns(surveyed.latest, 0) == round(second(59).timestamp()) * 10**9


def test_fixed_float_fixed_makes_two_segments() -> None:
    session, accepted = played(still(20) + still(5, 20, quality=5) + still(20, 25))
    surveyed = session.surveyed()
    assert len(accepted) == 40
    assert session.refusals[Reason.QUALITY] == 5
    assert surveyed is not None
    assert surveyed.mean.segments == 2


def test_a_fix_that_comes_back_elsewhere_is_refused() -> None:
    away = [gga(second(65 + i), PLACE, np.array([0.2, 0.1, 0.0])) for i in range(60)]
    session, _ = played(still(60) + still(5, 60, quality=5) + away)
    surveyed = session.surveyed()
    assert surveyed is not None
    assert "interruption" in surveyed.mean.fault


def test_a_tripod_that_was_moved_is_believed_again_after_the_window() -> None:
    away = [gga(second(60 + i), PLACE, np.array([5.0, 0.0, 0.0])) for i in range(int(STATIC_WINDOW_S) + 30)]
    session, _ = played(still(60) + away)
    surveyed = session.surveyed()
    assert surveyed is not None
    assert not surveyed.mean.fault


def test_restart_forgets() -> None:
    session, _ = played(still(20))
    session.restart()
    assert session.surveyed() is None


def test_counts_add_up() -> None:
    session, accepted = played(still(20) + still(5, 20, quality=5) + still(3, 25, age="9.0") + still(20, 28))
    refused = sum(session.refusals.values())
    assert session.counts["epochs"] == len(accepted) + refused == 48
    assert session.counts["accepted"] == len(accepted)


def test_midnight_and_the_hosts_day() -> None:
    late = [dt.datetime(2026, 6, 1, 23, 59, 50, tzinfo=dt.UTC) + dt.timedelta(seconds=i) for i in range(20)]
    host_ns = round(late[-1].timestamp() * 1e9) + 400_000_000
    session, accepted = played(gga(t, PLACE) for t in late)
    assert len(accepted) == 20
    surveyed = session.surveyed()
    assert surveyed is not None
    assert t_unix_ns(surveyed.latest, host_ns) == round(late[-1].timestamp()) * 10**9
    _, dated = played(gga(t, PLACE) + zda(t) for t in late)
    assert t_unix_ns(dated[0], 0) == round(late[0].timestamp()) * 10**9


def test_a_wrapped_week_counter_is_refused_live() -> None:
    old = [dt.datetime(2006, 10, 15, 12, 0, i, tzinfo=dt.UTC) for i in range(10)]
    live = StaticSession(SERVICES["own-base"], Policy(earliest=dt.date(2025, 1, 1)))
    _, accepted = played((gga(t, PLACE) + rmc(t) for t in old), live)
    assert accepted == []
    assert live.refusals[Reason.DATE] == 10


@settings(max_examples=60)
@given(st.lists(st.tuples(st.integers(0, 8000), st.integers(0, 7)), min_size=1, max_size=120), st.randoms())
def test_flipped_bits_never_move_an_accepted_epoch(flips: list[tuple[int, int]], random: object) -> None:
    stream = bytearray(b"".join(still(60)))
    for at, bit in flips:
        stream[at % len(stream)] ^= 1 << bit
    _, accepted = played([bytes(stream)])
    truth = Position(0, None, PLACE.lat_deg, PLACE.lon_deg, PLACE.altitude_m + PLACE.separation_m, (0, 0), "truth")
    assert all(np.linalg.norm(offset_m(position, truth)) < 0.05 for position in accepted)


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=300), max_size=10))
def test_any_bytes_at_all(pieces: list[bytes]) -> None:
    session, accepted = played(pieces)
    assert accepted == []
    assert session.surveyed() is None


@needs_recordings
@pytest.mark.parametrize(
    ("name", "accepted", "fault"),
    [
        # Whole files whose every epoch has one reason to be refused.
        ("f9p_highprec_q2.nmea", 0, None),
        ("f9p_hpg132_rtkfloat.ubx", 0, None),
        ("f9p_hppos_nofixrtk.ubx", 0, None),
        ("f9r_rtkfloat_mixed_gst.bin", 0, None),
        ("unicore_um621_blank_separation.bin", 0, None),
        ("quectel_lc79d_blank_separation.nmea", 0, None),
        ("skytraq_px1172_rtkfloat.nmea", 0, None),
        ("rtcm3_stream.bin", 0, None),
        ("nmea_fuzzy_cases.nmea", 0, None),  # quality 4, corrections 7.6 s old
        ("trimble_moving_q2_to_q4.nmea", 0, None),  # the same
        ("mixed_nmea_ubx_rtcm_sbf_etc.bin", 0, None),  # quality 4, five decimals
        ("f9p_static_q4_2hz.nmea", 120, "moved"),  # quality 4 throughout, and it wanders 0.3 m
        ("x5_static_1m_baseline_rtklib.nmea", 270, ""),  # 273 fixed epochs, three lone ones between floats
    ],
)
def test_recordings(name: str, accepted: int, fault: str | None) -> None:
    session, positions = played([(RECORDINGS / name).read_bytes()])
    assert len(positions) == accepted
    surveyed = session.surveyed()
    if fault is None:
        assert surveyed is None
        return
    assert surveyed is not None
    assert (fault in surveyed.mean.fault) if fault else not surveyed.mean.fault


@needs_recordings
def test_every_recording_passes_without_an_exception() -> None:
    for path in sorted(RECORDINGS.iterdir()):
        session, accepted = played([path.read_bytes()])
        assert session.counts["epochs"] == len(accepted) + sum(session.refusals.values()), path.name


@pytest.mark.parametrize("first_east_m", [0.0, 2.0])
def test_two_receivers_on_one_port_are_never_averaged(first_east_m: float) -> None:
    """Antennas 2 m apart, both fixed, in the same instant."""
    session, start = StaticSession(), dt.datetime(2026, 6, 1, 12, tzinfo=dt.UTC)
    for second in range(60):
        t = start + dt.timedelta(seconds=second)
        for east_m in (first_east_m, 2.0 - first_east_m):
            session.feed(gga(t, PLACE, np.array([east_m, 0.0, 0.0])), float(second))
    assert session.surveyed() is None
    assert session.last_refusal is not None
    assert "2.00 m apart" in str(session.last_refusal)


@pytest.mark.parametrize("later_s", [0.2, 0.5])
def test_two_receivers_in_turn_are_named(later_s: float) -> None:
    session, start = StaticSession(), dt.datetime(2026, 6, 1, 12, tzinfo=dt.UTC)
    for second in range(60):
        for east_m, part_s in ((0.0, 0.0), (2.0, later_s)):
            t_s = second + part_s
            session.feed(gga(start + dt.timedelta(seconds=t_s), PLACE, np.array([east_m, 0.0, 0.0])), t_s)
    assert session.in_turn
    status = diagnose(session, session.surveyed(), Watch(0.0, 115200, 0, last_byte_s=60.0), 60.0)
    assert (status.state, status.level) == (ReceiverState.DOUBTED, "fail")
    assert "two receivers" in status.reason


def test_one_receiver_that_says_each_instant_twice_is_one() -> None:
    session, start = StaticSession(), dt.datetime(2026, 6, 1, 12, tzinfo=dt.UTC)
    for second in range(60):
        t = start + dt.timedelta(seconds=second)
        session.feed(gga(t, PLACE) + gga(t, PLACE), float(second))
    assert session.counts["accepted"] > 50
    assert not session.in_turn
