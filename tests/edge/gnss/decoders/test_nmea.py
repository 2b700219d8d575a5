"""One sentence -> one record: strictly, and what the tolerant parsers make up is refused."""

import datetime as dt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.gnss.decoder import MalformedError
from edge.gnss.decoders.nmea import Gga, Gsa, Gst, Rmc, Zda, read
from tools.doubles.receiver import Place, gga

NOON = dt.datetime(2026, 6, 1, 12, 0, 0, 250_000, tzinfo=dt.UTC)
GOOD = "GNGGA,120000.25,4846.4008666,N,00854.7249096,E,4,12,0.47,419.166,M,47.535,M,1.0,0123"


def test_gga() -> None:
    record = read(GOOD.encode())
    assert record == Gga(
        t_day_ms=43_200_250,
        lat_deg=pytest.approx(48 + 46.4008666 / 60, abs=1e-10),
        lon_deg=pytest.approx(8 + 54.7249096 / 60, abs=1e-10),
        quality=4,
        satellites=12,
        altitude_m=419.166,
        separation_m=47.535,
        age_s=1.0,
        station="0123",
        decimals=7,
        altitude_decimals=3,
    )


def test_blank_fields_are_none_and_never_zero() -> None:
    record = read(b"GPGGA,120000.00,,,,,0,00,,,M,,M,,")
    assert isinstance(record, Gga)
    assert (record.lat_deg, record.lon_deg, record.altitude_m, record.separation_m, record.age_s) == (None,) * 5


def test_the_other_sentences() -> None:
    assert read(b"GPGST,024603.00,3.2,6.6,4.7,47.3,5.8,5.6,22.0") == Gst(9_963_000, (5.6, 5.8, 22.0))
    assert read(b"GNRMC,092542.00,A,4846.4,N,00854.7,E,0.004,,010118,,,R,V") == Rmc(
        33_942_000, True, dt.date(2018, 1, 1), "R"
    )
    assert read(b"GPZDA,160012.71,11,03,2004,-1,00") == Zda(57_612_710, dt.date(2004, 3, 11))
    assert read(b"GNGSA,A,3,80,71,73,79,69,,,,,,,,1.83,1.09,1.47") == Gsa(1.83)


@pytest.mark.parametrize("body", [b"GPGSV,1,1,00", b"PUBX,00,1", b"PTNL,GGK,1", b"", b"GN", b"GNXXX,1"])
def test_a_sentence_of_another_kind_is_no_record(body: bytes) -> None:
    assert read(body) is None


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("419.166", "inf"),
        ("419.166", "nan"),
        ("419.166", "4e2"),
        ("4846.4008666", "4860.0000000"),
        ("4846.4008666", "9146.4008666"),
        ("00854.7249096", "19954.7249096"),
        ("00854.7249096", "0854.7249096"),
        (",N,", ",X,"),
        ("120000.25", "250000.25"),
        ("120000.25", "12:00:00"),
        (",1.0,0123", ",1.0"),
        (",1.0,0123", ",1.0,0123,"),
        (",4,12", ",,12"),
        ("4846.4008666,N", ",N"),
        ("4846.4", "4846,4"),
        ("4846.4", "484\udc66.4"),
    ],
)
def test_what_is_not_plain_is_malformed(old: str, new: str) -> None:
    assert old in GOOD
    with pytest.raises(MalformedError):
        read(GOOD.replace(old, new).encode("latin-1", "replace"))


def test_a_leap_second_is_on_no_clock() -> None:
    record = read(GOOD.replace("120000.25", "235960.00").encode())
    assert isinstance(record, Gga)
    assert record.t_day_ms >= 86_400_000


@pytest.mark.parametrize("body", [b"GNRMC,120000,A,,,,,,,310299,,,R,V", b"GPZDA,120000.00,31,02,2024,00,00"])
def test_an_impossible_date_is_malformed(body: bytes) -> None:
    with pytest.raises(MalformedError):
        read(body)


@given(st.binary(max_size=120))
def test_any_bytes_are_a_record_nothing_or_malformed(tail: bytes) -> None:
    for head in (b"GNGGA,", b"GNRMC,", b"GPGST,", b"GNZDA,", b"GNGSA,", b""):
        try:
            read(head + tail)
        except MalformedError:
            continue


@given(st.text(alphabet="0123456789.,-NSEWMAVRF", max_size=100))
def test_any_likely_text_is_a_record_nothing_or_malformed(tail: str) -> None:
    for head in ("GNGGA,120000.00,", "GNRMC,120000.00,A,", "GPGST,120000.00,"):
        try:
            read((head + tail).encode())
        except MalformedError:
            continue


@given(st.floats(-89.999, 89.999), st.floats(-179.999, 179.999), st.floats(-400, 8000), st.floats(-100, 80))
def test_a_place_survives_the_sentence(lat_deg: float, lon_deg: float, altitude_m: float, separation_m: float) -> None:
    record = read(gga(NOON, Place(lat_deg, lon_deg, altitude_m, separation_m))[1:-5])
    assert isinstance(record, Gga)
    # Half a step of 1e-7 minute, and pynmeagps's own rounding to 1e-10 degree.
    assert record.lat_deg == pytest.approx(lat_deg, abs=1.0e-9)
    assert record.lon_deg == pytest.approx(lon_deg, abs=1.0e-9)
    assert record.altitude_m == pytest.approx(altitude_m, abs=5.1e-4)
    assert record.separation_m == pytest.approx(separation_m, abs=5.1e-4)


def body(*fields: tuple[int, str], name: str = "GNGGA") -> bytes:
    """A good GGA's text with some of its fields (1 is the time) written otherwise."""
    written = GOOD.split(",")
    written[0] = name
    for number, text in fields:
        written[number] = text
    return ",".join(written).encode()


@pytest.mark.parametrize("name", ["BDGGA", "QZGGA", "IIGGA", "GBGGA", "GQGGA", "INGGA"])
def test_whatever_system_the_talker_names_it_is_a_position(name: str) -> None:
    assert read(body(name=name)) == read(body())


@pytest.mark.parametrize(
    ("field", "text"),
    [(7, "112"), (8, ".5"), (8, "nan"), (8, "99.99"), (9, "+419.166"), (11, "+47.535"), (14, "VRS1"), (14, "12345")],
)
def test_what_is_unambiguous_is_read(field: int, text: str) -> None:
    record, usual = read(body((field, text))), read(body())
    assert isinstance(record, Gga)
    assert isinstance(usual, Gga)
    assert (record.altitude_m, record.separation_m, record.lat_deg, record.quality) == (
        usual.altitude_m, usual.separation_m, usual.lat_deg, usual.quality,
    )  # fmt: skip


def test_age_and_station_may_be_left_out() -> None:
    record = read(b",".join(body().split(b",")[:-2]))
    assert isinstance(record, Gga)
    assert (record.age_s, record.station, record.altitude_m) == (None, "", 419.166)


@pytest.mark.parametrize(
    ("field", "text", "named"),
    [(9, "nan", "altitude 'nan'"), (6, "RTK fixed", "quality 'RTK fixed'"), (11, "4e1", "separation '4e1'")],
)
def test_a_field_that_cannot_be_read_is_named(field: int, text: str, named: str) -> None:
    with pytest.raises(MalformedError, match=named):
        read(body((field, text)))
