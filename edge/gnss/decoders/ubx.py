"""UBX: the two messages a survey needs, NAV-PVT (time, mode) and NAV-HPPOSLLH (0.1 mm position); and NAV-RELPOSNED.

The hazard is the half-valid message: an old firmware leaves fields at zero, a cold receiver sends a time that is whole
seconds off until it is resolved, `nano` may be negative, and a position may carry an `invalid` flag. NAV-PVT alone has
steps of 11 mm; only with NAV-HPPOSLLH of the same iTOW is it good enough to average. NAV-RELPOSNED says how far the
base is, unless it is of two antennas on one mast.
"""

import datetime as dt
import math
from dataclasses import dataclass
from typing import Any, Final

from pyubx2 import UBXReader
from pyubx2.exceptions import UBXMessageError, UBXParseError, UBXTypeError

from edge.gnss.decoder import Cut, Decoder, MalformedError
from edge.gnss.epoch import MS_PER_DAY, Part, Place

MAX_PAYLOAD: Final = 8192  # bytes: the longest message of a u-blox F9 is shorter
OVERHEAD: Final = 8  # bytes about a payload: sync, class, id, length, and two of a checksum
PVT_STEP_M: Final = (0.011, 0.001)  # 1e-7 degrees, and millimetres
HIGH_PRECISION_STEP_M: Final = (1.1e-4, 1e-4)  # 1e-9 degrees, and tenths of millimetres
PVT_DATE_RANK: Final = 3  # its four-digit year is said to be resolved, which no sentence's is
_NAV_PVT: Final = b"\x01\x07"
_NAV_HPPOSLLH: Final = b"\x01\x14"
_NAV_RELPOSNED: Final = b"\x01\x3c"
_NAMES: Final = {_NAV_PVT: "NAV-PVT", _NAV_HPPOSLLH: "NAV-HPPOSLLH", _NAV_RELPOSNED: "NAV-RELPOSNED"}
CENTIMETRE_M: Final = 0.01
LONGEST_BASELINE_M: Final = 1e5  # nobody fixes ambiguities over more
_QUALITY_OF_CARRIER: Final = {0: None, 1: 5, 2: 4}  # float, fixed: as GGA numbers them
# Upper ends, in seconds, of NAV-PVT's buckets of correction age; bucket 0 says that it is not available.
_AGE_BUCKET_S: Final = (None, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0)


@dataclass(frozen=True)
class Pvt:
    """Navigation solution: time, mode, and a position in steps of 11 mm. quality: as in GGA."""

    t_day_ms: int
    itow_ms: int
    date: dt.date
    time_resolved: bool
    quality: int
    satellites: int
    lat_deg: float
    lon_deg: float
    height_m: float
    age_s: float | None


@dataclass(frozen=True)
class HighPrecision:
    """Position in steps of 0.1 mm, ellipsoidal height, and the receiver's own accuracy: horizontal, vertical."""

    itow_ms: int
    lat_deg: float
    lon_deg: float
    height_m: float
    sigma_m: tuple[float, float]


@dataclass(frozen=True)
class Relative:
    """How far away the base is whose corrections are used."""

    baseline_m: float


class Ubx(Decoder):
    """u-blox's binary protocol."""

    name = "ubx"
    sync = b"\xb5\x62"
    wanted = "NAV-PVT and NAV-HPPOSLLH"

    def cut(self, buffer: bytes, start: int) -> Cut | None:
        """The whole message, sync included."""
        if len(buffer) < start + 6:
            return None
        length = int.from_bytes(buffer[start + 4 : start + 6], "little")
        end = start + OVERHEAD + length
        if length > MAX_PAYLOAD:
            return Cut(start + 1)
        if len(buffer) < end:
            return None
        if fletcher(buffer[start + 2 : end - 2]) != buffer[end - 2 : end]:
            return Cut(start + 1, checksum_failed=True)
        return Cut(end, buffer[start:end])

    def decode(self, body: bytes) -> Part | None:
        """What a message says of its epoch."""
        record = read(body)
        return None if record is None else part(record)


def part(record: Pvt | HighPrecision | Relative) -> Part:
    """What a message says, in neutral terms."""
    if isinstance(record, Relative):
        return Part("NAV-RELPOSNED", baseline_m=record.baseline_m)
    if isinstance(record, HighPrecision):
        place = Place(record.lat_deg, record.lon_deg, record.height_m, HIGH_PRECISION_STEP_M, "steps of 0.1 mm")
        return Part("NAV-HPPOSLLH", tow_ms=record.itow_ms, place=place, sigma_m=record.sigma_m)
    resolution = "NAV-PVT alone has steps of 11 mm: enable NAV-HPPOSLLH"
    return Part(
        "NAV-PVT",
        record.t_day_ms,
        tow_ms=record.itow_ms,
        quality=record.quality,
        satellites=record.satellites,
        age_s=record.age_s,
        place=Place(record.lat_deg, record.lon_deg, record.height_m, PVT_STEP_M, resolution),
        date=record.date if record.time_resolved else None,
        date_rank=PVT_DATE_RANK,
    )


def fletcher(data: bytes) -> bytes:
    """The two check bytes of a UBX message over class, id, length and payload (u-blox interface description, 3.4)."""
    a = b = 0
    for byte in data:
        a += byte
        b += a
    return bytes((a & 0xFF, b & 0xFF))


def read(message: bytes) -> Pvt | HighPrecision | Relative | None:
    """The record in a checked UBX message; None for one that is not used or is flagged invalid.

    Raises MalformedError for one that is not what its class and id say.
    """
    name = message[2:4]
    if name not in _NAMES:
        return None
    try:
        fields = UBXReader.parse(message)
        if name == _NAV_RELPOSNED:
            return _relative(fields)
        itow_ms = int.from_bytes(message[6:10] if name == _NAV_PVT else message[10:14], "little")
        return _pvt(fields, itow_ms) if name == _NAV_PVT else _high_precision(fields, itow_ms)
    except (UBXParseError, UBXMessageError, UBXTypeError, ValueError, AttributeError, IndexError) as error:
        raise MalformedError(_NAMES[name]) from error


def _pvt(fields: Any, itow_ms: int) -> Pvt | None:
    if fields.invalidLlh or not (fields.validDate and fields.validTime):
        return None
    moment = dt.datetime(fields.year, fields.month, fields.day, fields.hour, fields.min, 0, tzinfo=dt.UTC)
    moment += dt.timedelta(seconds=fields.second, microseconds=round(fields.nano / 1000))
    # The time is stamped in whole milliseconds by every sentence that names the same epoch.
    t_unix_ms = round(moment.timestamp() * 1000)
    return Pvt(
        t_day_ms=t_unix_ms % MS_PER_DAY,
        itow_ms=itow_ms,
        date=dt.datetime.fromtimestamp(t_unix_ms / 1000, dt.UTC).date(),
        time_resolved=bool(fields.fullyResolved),
        quality=_quality(fields),
        satellites=fields.numSV,
        lat_deg=fields.lat,
        lon_deg=fields.lon,
        height_m=fields.height / 1000,
        age_s=_AGE_BUCKET_S[fields.lastCorrectionAge] if fields.lastCorrectionAge < len(_AGE_BUCKET_S) else 999.0,
    )


def _quality(fields: Any) -> int:
    if not fields.gnssFixOk or fields.fixType not in (3, 4):
        return 6 if fields.fixType == 1 else 0
    return _QUALITY_OF_CARRIER.get(fields.carrSoln) or (2 if fields.diffSoln else 1)


def _high_precision(fields: Any, itow_ms: int) -> HighPrecision | None:
    if fields.invalidLlh:
        return None
    sigma_m = (fields.hAcc / 1000, fields.vAcc / 1000)
    return HighPrecision(itow_ms, fields.lat, fields.lon, fields.height / 1000, sigma_m)


def _relative(fields: Any) -> Relative | None:
    """None where the other end is no base: it moves with this antenna, or only a direction is told."""
    if not fields.relPosValid or fields.isMoving or getattr(fields, "relPosNormalized", 0):
        return None
    baseline_m = CENTIMETRE_M * math.hypot(fields.relPosN, fields.relPosE, fields.relPosD)
    return Relative(baseline_m) if baseline_m <= LONGEST_BASELINE_M else None
