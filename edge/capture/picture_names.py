"""When the pictures of a folder were taken, by their names. Pure.

The hazard is the name that sorts wrongly or whose time is not understood: 10.png comes before 2.png, milliseconds are
taken for a serial number, missing numbers are closed up. So names are in natural order, the usual ways to write a time
are read, numbers with gaps keep their gaps, and what is understood is said.
"""

import datetime as dt
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

# Digits of a UNIX time that begins with 1: 2001 to 2033, in each unit, with the factor to ns. TUM RGB-D has a fraction.
_UNIX: Final = (
    ("nanoseconds", re.compile(r"(?<!\d)(1\d{18})(?!\d)"), 1),
    ("microseconds", re.compile(r"(?<!\d)(1\d{15})(?!\d)"), 10**3),
    ("milliseconds", re.compile(r"(?<!\d)(1\d{12})(?!\d)"), 10**6),
    ("seconds", re.compile(r"(?<!\d)(1\d{9}(?:\.\d{1,9})?)(?!\d)"), 10**9),
)
_DATE: Final = re.compile(
    r"(?<!\d)(20\d\d)[-_.]?(0[1-9]|1[0-2])[-_.]?(0[1-9]|[12]\d|3[01])[-_T. ]+"
    r"([01]\d|2[0-3])[-_.:h]?([0-5]\d)[-_.:m]?([0-5]\d)(?:[-_.,]?(\d{1,9}))?(?!\d)"
)
STRANGE_NAMES: Final = 0.15  # share of a folder's pictures that are of another kind: a snapshot, a cover
_NUMBERS: Final = re.compile(r"\d+")


@dataclass(frozen=True)
class NameTimes:
    """How names are read. of: a stem to ns, UTC where `absolute`, else to a number of pictures; None: it has none.

    by_order: none has; they are taken as they come.
    """

    what: str
    of: Callable[[str], int | None]
    absolute: bool
    by_order: bool = False


def natural(name: str) -> tuple[tuple[bool, int, str], ...]:
    """A key by which 2 comes before 10."""
    parts = re.split(r"(\d+)", name)
    return tuple((part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts)


def understand(stems: Sequence[str]) -> NameTimes:
    """The one reading in which all names but strange ones have a time, no two the same; else numbers; else order."""
    for what, pattern, factor in _UNIX:
        reading = NameTimes(f"UNIX {what}", _unix_reader(pattern, factor), absolute=True)
        if _tells_apart(reading, stems):
            return reading
    reading = NameTimes("dates, taken as UTC", _date_ns, absolute=True)
    if _tells_apart(reading, stems):
        return reading
    groups = max((len(_NUMBERS.findall(stem)) for stem in stems), default=0)
    for group in range(1, groups + 1):  # the last number first: what stands before it names the camera
        reading = NameTimes("numbers", _number_reader(-group), absolute=False)
        if _tells_apart(reading, stems):
            return reading
    return NameTimes("order", lambda stem: None, absolute=False, by_order=True)


def _tells_apart(reading: NameTimes, stems: Sequence[str]) -> bool:
    times = [time for time in map(reading.of, stems) if time is not None]
    strange = len(stems) - len(times)
    return bool(times) and strange <= STRANGE_NAMES * len(stems) and len(set(times)) == len(times)


def _unix_reader(pattern: re.Pattern[str], factor: int) -> Callable[[str], int | None]:
    def read(stem: str) -> int | None:
        match = pattern.search(stem)
        if match is None:
            return None
        whole, _, fraction = match[1].partition(".")
        return int(whole) * factor + (int(fraction.ljust(9, "0")) if fraction else 0)

    return read


def _date_ns(stem: str) -> int | None:
    match = _DATE.search(stem)
    if match is None:
        return None
    year, month, day, hour, minute, second = (int(match[k]) for k in range(1, 7))
    try:
        whole = dt.datetime(year, month, day, hour, minute, second, tzinfo=dt.UTC)
    except ValueError:
        return None
    return int(whole.timestamp()) * 10**9 + int((match[7] or "").ljust(9, "0"))


def _number_reader(group: int) -> Callable[[str], int | None]:
    def read(stem: str) -> int | None:
        numbers = _NUMBERS.findall(stem)
        return int(numbers[group]) if len(numbers) >= -group else None

    return read
