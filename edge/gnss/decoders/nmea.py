"""NMEA 0183: sentences -> typed records -> what they say of an epoch, or the reason why they say nothing.

The hazard is the tolerant parser. Off the shelf a blank position becomes 0, 0, a blank geoid separation 0 m (38 m wrong
in Tsukuba), `inf` an altitude, and latitude 91 a latitude. So a strict grammar comes first: plain numbers, minutes
below 60, hemisphere letters, exactly the fields the sentence has. Only what passes is decoded: numbers by pynmeagps,
times and dates here, because parsers lose a leap second and turn an impossible date into none. What decides about a
survey but is lost in a float (how many decimals were sent, that a field was blank) is kept beside it.
"""

import datetime as dt
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Any, Final

from pynmeagps import NMEAReader
from pynmeagps.exceptions import NMEAMessageError, NMEAParseError, NMEATypeError

from edge.gnss.decoder import Cut, Decoder, MalformedError
from edge.gnss.epoch import MS_PER_DAY, Part, Place

_SENTENCE: Final = re.compile(rb"\$([ -#%-)+-~]{5,250})\*([0-9A-Fa-f]{2})")  # longer than the standard's 82 bytes too
_UNFINISHED: Final = re.compile(rb"\$[ -#%-)+-~]{0,250}(?:\*[0-9A-Fa-f]?)?\Z")
_M_PER_MINUTE: Final = 1855.0  # of latitude, the most of it: at the poles 1862, at the equator 1843
_RMC_OF_A_FIX: Final = (
    "",
    "R",
    "D",
    "A",
    "P",
)  # old ones say A or D of a fixed solution; F, E and the rest deny it
_ZDA_RANK, _RMC_RANK = 2, 1  # a year of four digits before one of two

_TIME: Final = r"(?P<hour>[01]\d|2[0-3])(?P<minute>[0-5]\d)(?P<second>[0-5]\d|60)(?:\.(?P<fraction>\d{1,6}))?"
_LAT: Final = r"(?P<lat_deg>\d\d)(?P<lat_min>[0-5]\d)(?:\.(?P<lat_decimals>\d{1,12}))?,(?P<ns>[NS])"
_LON: Final = r"(?P<lon_deg>[01]\d\d)(?P<lon_min>[0-5]\d)(?:\.(?P<lon_decimals>\d{1,12}))?,(?P<ew>[EW])"
_NUMBER: Final = r"[-+]?\d{1,7}(?:\.\d{1,9})?"
# Satellite systems, alone (BD and QZ as some makers write BeiDou and QZSS) and together; II, IN: integrated navigation.
_TALKER: Final = r"(?:G[A-Z]|BD|QZ|II|IN)"
_TALKERS: Final = re.compile(_TALKER)
_SHORT_GGA_FIELDS: Final = 13  # name included, where age of corrections and station are left out
# Of each field of a GGA, name first, what it may hold: to say which of them is wrong.
_GGA_FIELDS: Final = (
    ("name", rf"{_TALKER}GGA"), ("time", _TIME), ("latitude", r"(?:\d\d[0-5]\d(?:\.\d{1,12})?)?"), ("N or S", "[NS]?"),
    ("longitude", r"(?:[01]\d\d[0-5]\d(?:\.\d{1,12})?)?"), ("E or W", "[EW]?"), ("quality", r"\d{1,2}"),
    ("satellites", r"\d{0,3}"), ("HDOP", r"[-.\w]*"), ("altitude", rf"(?:{_NUMBER})?"), ("M", "M?"),
    ("separation", rf"(?:{_NUMBER})?"), ("M", "M?"), ("age", rf"(?:{_NUMBER})?"), ("station", r"\w{0,8}"),
)  # fmt: skip

_GRAMMAR: Final[dict[str, re.Pattern[str]]] = {
    "GGA": re.compile(
        rf"{_TALKER}GGA,{_TIME},(?:{_LAT},{_LON}|,,,),(?P<quality>\d{{1,2}}),(?P<satellites>\d{{0,3}}),[-.\w]*,"
        rf"(?P<altitude>(?:[-+]?\d{{1,7}}(?:\.(?P<altitude_decimals>\d{{1,9}}))?)?),M?,(?P<separation>(?:{_NUMBER})?),M?,"
        rf"(?P<age>(?:{_NUMBER})?),(?P<station>\w{{0,8}})"
    ),
    "GST": re.compile(
        rf"{_TALKER}GST,{_TIME},(?:{_NUMBER})?,(?:{_NUMBER})?,(?:{_NUMBER})?,(?:{_NUMBER})?,"
        rf"(?P<lat_sigma>{_NUMBER}),(?P<lon_sigma>{_NUMBER}),(?P<alt_sigma>{_NUMBER})"
    ),
    "RMC": re.compile(
        rf"{_TALKER}RMC,{_TIME},(?P<status>[AV]),(?:{_LAT},{_LON}|,,,),(?:{_NUMBER})?,(?:{_NUMBER})?,"
        rf"(?:(?P<day>[0-3]\d)(?P<month>[01]\d)(?P<year>\d\d))?,(?:{_NUMBER})?,[EW]?(?:,(?P<mode>[A-Z])?(?:,[A-Z]?)?)?"
    ),
    "ZDA": re.compile(
        rf"{_TALKER}ZDA,{_TIME},(?P<day>[0-3]\d),(?P<month>[01]\d),(?P<year>[12]\d\d\d),(?:-?\d{{1,2}})?,(?:\d\d?)?"
    ),
    "GSA": re.compile(
        rf"{_TALKER}GSA,[MA]?,[123]?,(?:\d{{0,3}},){{12}}(?P<pdop>(?:{_NUMBER})?),(?:{_NUMBER})?,(?:{_NUMBER})?(?:,\d?)?"
    ),
}


@dataclass(frozen=True)
class Gga:
    """A position sentence. height_m: altitude + separation of this very sentence, None where either is blank.

    decimals: of the minutes of latitude and longitude, the fewer. age_s: of the corrections, None where blank.
    """

    t_day_ms: int
    lat_deg: float | None
    lon_deg: float | None
    quality: int
    satellites: int
    altitude_m: float | None
    separation_m: float | None
    age_s: float | None
    station: str
    decimals: int
    altitude_decimals: int


@dataclass(frozen=True)
class Gst:
    """What the receiver itself believes: one sigma, east, north, up, metres."""

    t_day_ms: int
    sigma_m: tuple[float, float, float]


@dataclass(frozen=True)
class Rmc:
    """Date and mode. mode: R fixed, F float, A, D, P ..., empty where an old receiver does not say."""

    t_day_ms: int
    valid: bool
    date: dt.date | None
    mode: str


@dataclass(frozen=True)
class Zda:
    """Date."""

    t_day_ms: int
    date: dt.date


@dataclass(frozen=True)
class Gsa:
    """Dilution of precision; repeated for each constellation, and the one sentence here without a time."""

    pdop: float | None


Record = Gga | Gst | Rmc | Zda | Gsa


class Nmea(Decoder):
    """NMEA 0183, of any talker of positions."""

    name = "nmea"
    sync = b"$"
    wanted = "GGA"

    def cut(self, buffer: bytes, start: int) -> Cut | None:
        """The text between `$` and `*`."""
        found = _SENTENCE.match(buffer, start)
        if found is None:
            return None if _UNFINISHED.match(buffer, start) else Cut(start + 1)
        if reduce(xor, found[1]) != int(found[2], 16):
            return Cut(start + 1, checksum_failed=True)
        return Cut(found.end(), found[1])

    def decode(self, body: bytes) -> Part | None:
        """What a sentence says of its epoch."""
        record = read(body)
        return None if record is None else part(record)


def part(record: Record) -> Part:
    """What a sentence says, in neutral terms."""
    match record:
        case Gga():
            place = _place(record)
            return Part(
                "GGA", record.t_day_ms, quality=record.quality, age_s=record.age_s, place=place,
                satellites=record.satellites,
            )  # fmt: skip
        case Gst():
            return Part("GST", record.t_day_ms, sigma_m=record.sigma_m)
        case Rmc():
            fixed = record.valid and record.mode in _RMC_OF_A_FIX
            contradiction = "" if fixed else f"RMC says {record.mode or 'invalid'}"
            return Part("RMC", record.t_day_ms, date=record.date, date_rank=_RMC_RANK, contradiction=contradiction)
        case Zda():
            return Part("ZDA", record.t_day_ms, date=record.date, date_rank=_ZDA_RANK)
        case Gsa():
            return Part("GSA", pdop=record.pdop)


def _place(gga: Gga) -> Place | None:
    if gga.lat_deg is None or gga.lon_deg is None or gga.altitude_m is None:
        return None
    step_m = (_M_PER_MINUTE * 10.0**-gga.decimals, 10.0**-gga.altitude_decimals)
    above_geoid = gga.separation_m is None
    height_m = gga.altitude_m + (gga.separation_m or 0.0)
    resolution = f"{gga.decimals} decimals of a minute"
    return Place(gga.lat_deg, gga.lon_deg, height_m, step_m, resolution, above_geoid, gga.separation_m)


def read(body: bytes) -> Record | None:
    """The record in a sentence's text between `$` and `*`; None for a sentence that is not used here.

    Raises MalformedError where a used sentence breaks its grammar or its range.
    """
    name = body[2:5].decode("latin-1")
    grammar = _GRAMMAR.get(name)
    text = body.decode("latin-1")
    if grammar is None or body[5:6] != b"," or not _TALKERS.match(text):
        return None
    if name == "GGA":
        text, body = _usual_gga(text)
    fields = grammar.fullmatch(text)
    if fields is None:
        raise MalformedError(_wrong_in_gga(text) if name == "GGA" else name)
    try:
        return _READERS[name](fields, body)
    except (NMEAParseError, NMEAMessageError, NMEATypeError, ValueError, TypeError) as error:
        raise MalformedError(name) from error


def _usual_gga(text: str) -> tuple[str, bytes]:
    """A GGA with all its fields, and the same for pynmeagps: without what is not used and may be no number."""
    fields = text.split(",")
    if len(fields) == _SHORT_GGA_FIELDS:
        fields += [""] * (len(_GGA_FIELDS) - len(fields))
    plain = [*fields]
    if len(plain) == len(_GGA_FIELDS):
        plain[8] = plain[14] = ""
    return ",".join(fields), ",".join(plain).encode("latin-1")


def _wrong_in_gga(text: str) -> str:
    """Which field of a GGA breaks the grammar."""
    fields = text.split(",")
    if len(fields) != len(_GGA_FIELDS):
        return f"GGA with {len(fields) - 1} fields, not {len(_GGA_FIELDS) - 1}"
    for text_of, (what, pattern) in zip(fields, _GGA_FIELDS, strict=True):
        if not re.fullmatch(re.sub(r"\?P<\w+>", "?:", pattern), text_of):
            return f"GGA with {what} {text_of!r}"
    return "GGA with half a position"


def _parse(body: bytes) -> Any:
    """pynmeagps's message. The checksum was ours to judge, so it is not computed again."""
    message = NMEAReader.parse(b"$" + body + b"*00\r\n", validate=0)
    if message is None:
        raise MalformedError(body[2:5].decode("latin-1"))
    return message


def _t_day_ms(fields: re.Match[str]) -> int:
    """Milliseconds since midnight UTC; a leap second is 86 400 000 and more, which is on no clock."""
    whole = (int(fields["hour"]) * 60 + int(fields["minute"])) * 60 + int(fields["second"])
    if fields["second"] == "60":
        whole = max(whole, MS_PER_DAY // 1000)
    return whole * 1000 + int(float("0." + (fields["fraction"] or "0")) * 1000 + 0.5)


def _date(fields: re.Match[str], *, century: int) -> dt.date:
    return dt.date(century + int(fields["year"]), int(fields["month"]), int(fields["day"]))


def _gga(fields: re.Match[str], body: bytes) -> Gga:
    message = _parse(body)
    has_position = fields["lat_deg"] is not None
    if has_position and (abs(message.lat) > 90 or abs(message.lon) > 180):
        raise MalformedError("GGA")
    return Gga(
        t_day_ms=_t_day_ms(fields),
        lat_deg=message.lat if has_position else None,
        lon_deg=message.lon if has_position else None,
        quality=message.quality,
        satellites=int(fields["satellites"] or 0),
        altitude_m=message.alt if fields["altitude"] else None,
        separation_m=message.sep if fields["separation"] else None,
        age_s=float(fields["age"]) if fields["age"] else None,
        station=fields["station"],
        decimals=min(len(fields["lat_decimals"] or ""), len(fields["lon_decimals"] or "")),
        altitude_decimals=len(fields["altitude_decimals"] or ""),
    )


def _gst(fields: re.Match[str], body: bytes) -> Gst:
    message = _parse(body)
    return Gst(_t_day_ms(fields), (message.stdLong, message.stdLat, message.stdAlt))


def _rmc(fields: re.Match[str], _body: bytes) -> Rmc:
    date = _date(fields, century=2000) if fields["day"] else None
    return Rmc(_t_day_ms(fields), fields["status"] == "A", date, fields["mode"] or "")


def _zda(fields: re.Match[str], _body: bytes) -> Zda:
    return Zda(_t_day_ms(fields), _date(fields, century=0))


def _gsa(fields: re.Match[str], body: bytes) -> Gsa:
    return Gsa(_parse(body).PDOP if fields["pdop"] else None)


_READERS: Final[dict[str, Callable[[re.Match[str], bytes], Record]]] = {
    "GGA": _gga,
    "GST": _gst,
    "RMC": _rmc,
    "ZDA": _zda,
    "GSA": _gsa,
}
