"""How a receiver stands, in one line: all that an RTK user looks at first, and what is not told is said so."""

import struct

import numpy as np
import pytest

from edge.gnss.averaging import SERVICES
from edge.gnss.decoders.ubx import fletcher
from edge.gnss.outlook import outlook
from edge.gnss.session import SETTLING_S, StaticSession
from tests.edge.gnss.test_session import second
from tools.doubles.receiver import Place, gga, rmc

PLACE = Place()


def relposned(length_m: float, *, flags: int = 0b10111, version: int = 1) -> bytes:
    """NAV-RELPOSNED, the base that far north: valid, fixed, not moving."""
    whole_cm = round(length_m * 100)
    if version == 1:
        body = struct.pack("<BBHI", 1, 0, 7, 1000) + struct.pack("<iiiii4x", whole_cm, 0, 0, whole_cm, 0)
        body += struct.pack("<bbbb5I4xI", 0, 0, 0, 0, 100, 100, 100, 100, 100, flags)
    else:
        body = struct.pack("<BBHI", 0, 0, 7, 1000) + struct.pack("<iii", whole_cm, 0, 0)
        body += struct.pack("<bbbb3II", 0, 0, 0, 0, 100, 100, 100, flags)
    message = b"\x01\x3c" + len(body).to_bytes(2, "little") + body
    return b"\xb5\x62" + message + fletcher(message)


def line(session: StaticSession) -> str:
    return outlook(session, session.surveyed())


def fed(session: StaticSession, seconds: range, more: bytes = b"", **fields: object) -> StaticSession:
    for count in seconds:
        said = gga(second(count), PLACE, np.zeros(3), **fields) + rmc(second(count)) + more  # type: ignore[arg-type]
        session.feed(said, float(count))
        session.feed(b"", count + 0.5)
    return session


def test_all_of_it_of_a_healthy_receiver() -> None:
    said = line(fed(StaticSession(), range(60), relposned(3214.0)))
    for words in ("RTK fixed", "12 satellites", "corrections 1 s old", "base 3.2 km away", "mm horizontal",
                  "mm vertical (60 epochs in 59 s)", "can be trusted"):  # fmt: skip
        assert words in said


def test_what_is_not_told_is_said_so() -> None:
    said = line(fed(StaticSession(), range(3), age=""))
    assert "baseline not told" in said
    assert "age of corrections not told" in said
    assert "base 350 m away (baseline_m)" in line(fed(StaticSession(baseline_m=350.0), range(3)))
    assert line(StaticSession()) == ""


@pytest.mark.parametrize(
    ("flags", "version", "told"),
    [(0b10111, 1, True), (0b10111, 0, True), (0b10011, 1, False), (0b110111, 1, False), (0b1000010111, 1, False)],
    ids=["first version", "version 0", "not valid", "two antennas on one mast", "a direction alone"],
)
def test_which_relative_positions_are_of_a_base(flags: int, version: int, told: bool) -> None:
    said = line(fed(StaticSession(), range(3), relposned(812.0, flags=flags, version=version)))
    assert ("base 812 m away" in said) is told


def test_a_distance_that_is_no_longer_told_is_not_kept() -> None:
    session = fed(StaticSession(), range(5), relposned(812.0))
    assert "baseline not told" in line(fed(session, range(5, 80)))


def test_a_base_far_away_widens_sigma_by_a_millionth_of_its_distance() -> None:
    near, far = fed(StaticSession(), range(300)), fed(StaticSession(), range(300), relposned(40_000.0))
    one, other = near.surveyed(), far.surveyed()
    assert one is not None
    assert other is not None
    assert other.mean.sigma_m == pytest.approx(np.hypot(one.mean.sigma_m, 0.040))


def test_when_it_can_be_trusted_is_counted_down() -> None:
    session = StaticSession(SERVICES["own-base"])
    assert "to be trusted 8 s after it is RTK fixed" in line(fed(session, range(2), quality=5))
    assert "no sigma yet" in line(session)
    assert "to be trusted in 2 s" in line(fed(session, range(2, 6)))
    assert "can be trusted" in line(fed(session, range(6, 20)))


def test_after_it_was_carried_it_is_counted_down_again() -> None:
    session = fed(StaticSession(), range(60))
    for count in range(60, 90):
        walked = gga(second(count), PLACE, np.array([0.5 * (count - 59), 0.0, 0.0])) + rmc(second(count))
        session.feed(walked, float(count))
        session.feed(b"", count + 0.5)
    for count in range(90, 110):
        session.feed(gga(second(count), PLACE, np.array([15.0, 0.0, 0.0])) + rmc(second(count)), float(count))
        session.feed(b"", count + 0.5)
    surveyed = session.surveyed()
    assert surveyed is not None
    assert surveyed.trusted_in_s is not None
    assert 30 < surveyed.trusted_in_s < SETTLING_S
    assert f"to be trusted in {surveyed.trusted_in_s:.0f} s" in line(session)
