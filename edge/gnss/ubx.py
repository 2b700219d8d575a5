"""The two UBX messages a survey needs -> typed records: NAV-PVT (time, mode) and NAV-HPPOSLLH (0.1 mm position).

The hazard is the half-valid message: an old firmware leaves fields at zero, a cold receiver sends a time that is whole
seconds off until it is resolved, `nano` may be negative, and a position may carry an `invalid` flag. NAV-PVT alone has
steps of 11 mm; only with NAV-HPPOSLLH of the same iTOW is it good enough to average.
"""

import datetime as dt
from dataclasses import dataclass
from typing import Any, Final

from pyubx2 import UBXReader
from pyubx2.exceptions import UBXMessageError, UBXParseError, UBXTypeError

from edge.gnss.nmea import MalformedError

_NAV_PVT: Final = b"\x01\x07"
_NAV_HPPOSLLH: Final = b"\x01\x14"
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


def decode(message: bytes) -> Pvt | HighPrecision | None:
    """The record in a checked UBX message; None for one that is not used or is flagged invalid.

    Raises MalformedError for one that is not what its class and id say.
    """
    name = message[2:4]
    if name not in (_NAV_PVT, _NAV_HPPOSLLH):
        return None
    try:
        fields = UBXReader.parse(message)
        itow_ms = int.from_bytes(message[6:10] if name == _NAV_PVT else message[10:14], "little")
        return _pvt(fields, itow_ms) if name == _NAV_PVT else _high_precision(fields, itow_ms)
    except (UBXParseError, UBXMessageError, UBXTypeError, ValueError, AttributeError, IndexError) as error:
        raise MalformedError("NAV-PVT" if name == _NAV_PVT else "NAV-HPPOSLLH") from error


def _pvt(fields: Any, itow_ms: int) -> Pvt | None:
    if fields.invalidLlh or not (fields.validDate and fields.validTime):
        return None
    moment = dt.datetime(fields.year, fields.month, fields.day, fields.hour, fields.min, 0, tzinfo=dt.UTC)
    moment += dt.timedelta(seconds=fields.second, microseconds=round(fields.nano / 1000))
    # The time is stamped in whole milliseconds by every sentence that names the same epoch.
    t_unix_ms = round(moment.timestamp() * 1000)
    return Pvt(
        t_day_ms=t_unix_ms % 86_400_000,
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
