"""NAV-PVT and NAV-HPPOSLLH: quality, age, time with a negative part of a second, and what is flagged invalid."""

import datetime as dt
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyubx2 import GET, UBXMessage

from edge.gnss.decoder import MalformedError
from edge.gnss.decoders.ubx import HighPrecision, Pvt, fletcher, read

TIME = {"iTOW": 408_639_750, "year": 2025, "month": 8, "day": 28, "hour": 17, "min": 30, "second": 22, "nano": 0}
FLAGS = {"validDate": 1, "validTime": 1, "fullyResolved": 1, "fixType": 3, "gnssFixOk": 1, "numSV": 25}
PLACE = {"lon": -105.1471665, "lat": 40.0966916, "height": 1_580_048}


def pvt(**change: object) -> bytes:
    """A NAV-PVT message."""
    fields = {**TIME, **FLAGS, **PLACE, "carrSoln": 2, "diffSoln": 1, "lastCorrectionAge": 2, **change}
    return bytes(UBXMessage("NAV", "NAV-PVT", GET, **fields).serialize())


def test_a_fixed_solution() -> None:
    record = read(pvt())
    assert isinstance(record, Pvt)
    assert (record.quality, record.age_s, record.satellites) == (4, 2.0, 25)
    assert (record.date, record.t_day_ms) == (dt.date(2025, 8, 28), 63_022_000)
    assert record.height_m == pytest.approx(1580.048)


@pytest.mark.parametrize(
    ("change", "quality"),
    [
        ({"carrSoln": 1}, 5),
        ({"carrSoln": 0}, 2),
        ({"carrSoln": 0, "diffSoln": 0}, 1),
        ({"gnssFixOk": 0}, 0),
        ({"fixType": 1}, 6),
        ({"fixType": 2}, 0),
    ],
)
def test_quality_is_numbered_as_in_gga(change: dict[str, object], quality: int) -> None:
    record = read(pvt(**change))
    assert isinstance(record, Pvt)
    assert record.quality == quality


def test_a_negative_nano_belongs_to_the_second_before() -> None:
    midnight = read(pvt(hour=0, min=0, second=0, nano=-250_000_000))
    assert isinstance(midnight, Pvt)
    assert (midnight.date, midnight.t_day_ms) == (dt.date(2025, 8, 27), 86_399_750)
    whole = read(pvt(nano=-127_759))
    assert isinstance(whole, Pvt)
    assert whole.t_day_ms == 63_022_000


@pytest.mark.parametrize(("bucket", "age_s"), [(0, None), (1, 1.0), (3, 5.0), (4, 10.0), (11, 120.0), (15, 999.0)])
def test_the_age_of_corrections_is_the_buckets_upper_end(bucket: int, age_s: float | None) -> None:
    record = read(pvt(lastCorrectionAge=bucket))
    assert isinstance(record, Pvt)
    assert record.age_s == age_s


@pytest.mark.parametrize("change", [{"invalidLlh": 1}, {"validDate": 0}, {"validTime": 0}])
def test_what_is_flagged_invalid_is_no_record(change: dict[str, object]) -> None:
    assert read(pvt(**change)) is None


def test_a_leap_second_and_an_impossible_date() -> None:
    leap = read(pvt(hour=23, min=59, second=60))
    assert isinstance(leap, Pvt)
    with pytest.raises(MalformedError):
        read(pvt(month=13))


def test_high_precision() -> None:
    # version, reserved, flags; iTOW; lon, lat 1e-7 deg; height, hMSL mm; their 1e-9 deg and 0.1 mm parts; hAcc, vAcc
    payload = struct.pack(
        "<B2xBIiiiibbbbII", 0, 0, 408_639_750, -1_051_471_665, 400_966_916, 1_580_048, 0, -34, 12, 3, 0, 140, 210
    )
    record = read(b"\xb5\x62\x01\x14\x24\x00" + payload + fletcher(b"\x01\x14\x24\x00" + payload))
    assert isinstance(record, HighPrecision)
    assert record.itow_ms == 408_639_750
    assert record.lat_deg == pytest.approx(40.096691612, abs=1.1e-9)
    assert record.height_m == pytest.approx(1580.0483, abs=1e-4)
    assert record.sigma_m == pytest.approx((0.014, 0.021))


@given(st.sampled_from([b"\x01\x07", b"\x01\x14", b"\x02\x15"]), st.binary(max_size=120))
def test_any_payload_is_a_record_nothing_or_malformed(name: bytes, payload: bytes) -> None:
    message = b"\xb5\x62" + name + len(payload).to_bytes(2, "little") + payload + b"\x00\x00"
    try:
        read(message)
    except MalformedError:
        return


@given(st.binary(min_size=92, max_size=92))
def test_any_navigation_solution_of_the_right_length(payload: bytes) -> None:
    try:
        read(b"\xb5\x62\x01\x07\x5c\x00" + payload + b"\x00\x00")
    except MalformedError:
        return
