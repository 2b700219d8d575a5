"""The columns of a track file that are more than numbers: when a row was seen, and under which track.

Two hazards. A stamp in another unit is a thousand or a million times too small, and one that a spreadsheet has shown as
1.78E+18 has lost its digits for good. Of what year a number is tells its unit, so the first is read and said; the
second is refused, as is what is no time since 1970 at all. And a track may be named by anything: only which rows have
the same name matters.
"""

import logging
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.station.archive.tables import UNSAID, CsvTable
from edge.messages import MAX_T_UNIX_NS, MIN_T_UNIX_NS

log = logging.getLogger(__name__)

STAMP: Final = "t_unix_ns"
TRACK_NUMBERS: Final = 2**53  # how many the wire has
NS_IN: Final = {"nanoseconds": 1, "microseconds": 10**3, "milliseconds": 10**6, "seconds": 10**9}
# Above it, stamps whose digits end there are no times of frames any more if several rows have the same: at 10 m/s an
# object moves 0.1 m in it.
COARSEST_STAMP_NS: Final = 10**7
SHARED_STAMPS: Final = 0.5  # of rows, that have their stamp with another row of their track
GIVE_NS: Final = "give whole nanoseconds since 1970 (or micro-, milliseconds or seconds, with their decimals)"


def stamps(table: CsvTable) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Stamps (N,) in ns, and which of them (N,) are times at all. Integers: a double is good to 0.2 us only.

    Raises ConfigError for text, for what is in no unit a time, and for stamps that have lost their digits.
    """
    exact = _exact(table)
    unit = _unit(table, exact)
    if unit != "nanoseconds":
        log.warning("%s: %s is in %s; read as such", table.source.path, STAMP, unit)
    ns = [_in_ns(value, NS_IN[unit]) for value in exact]
    good = np.array([value is not None for value in ns], bool)
    found = np.array([0 if value is None else value for value in ns], np.int64)
    _refuse_lost_digits(table, found, good)
    return found, good


def _exact(table: CsvTable) -> list[int] | list[Decimal | None]:
    """The stamps as written, None where there is none."""
    values = table.decimals(STAMP)
    try:
        return list(map(int, values))
    except ValueError:
        return [_decimal(table, row, value) for row, value in enumerate(values)]


def _decimal(table: CsvTable, row: int, value: str) -> Decimal | None:
    text = value.strip()
    if text.lower() in UNSAID:
        return None
    try:
        number = Decimal(text)
    except InvalidOperation as error:
        raise table.fault(row, f"{STAMP}: {value!r} is no number", GIVE_NS) from error
    return number if number.is_finite() else None


def _in_ns(value: int | Decimal | None, scale: int) -> int | None:
    # Compared before it is multiplied: 1e999999999 is a number too.
    if value is None or not MIN_T_UNIX_NS // scale <= value <= MAX_T_UNIX_NS // scale:
        return None
    return round(value * scale)


def _unit(table: CsvTable, exact: list[int] | list[Decimal | None]) -> str:
    """The unit in which most stamps lie between 2001 and 2096: no number does so in two of them."""
    said = [row for row, value in enumerate(exact) if value is not None]
    counts = {unit: sum(_in_ns(exact[row], scale) is not None for row in said) for unit, scale in NS_IN.items()}
    best = max(counts, key=lambda unit: counts[unit])
    if said and 2 * counts[best] <= len(said):
        row = next(row for row in said if _in_ns(exact[row], NS_IN[best]) is None)
        what = f"{STAMP}: {table.columns[STAMP][row]} is no time since 1970 in nanoseconds, nor in another unit"
        raise table.fault(row, what, GIVE_NS)
    return best


def _refuse_lost_digits(table: CsvTable, ns: NDArray[np.int64], good: NDArray[np.bool_]) -> None:
    known = ns[good]
    if len(known) < 2 or np.any(known % COARSEST_STAMP_NS):
        return
    own = tracks(table)[good]
    distinct = len(np.unique(np.column_stack([known, own]), axis=0))
    if distinct < SHARED_STAMPS * len(known) and _on_a_path(table, ns, good):
        row = int(np.flatnonzero(good)[0])
        what = (
            f"{STAMP}: stamps such as {table.columns[STAMP][row]} have lost their digits: "
            f"{len(known)} rows have {len(np.unique(known))} different times"
        )
        raise table.fault(
            row, what, "write them again from the source, as whole numbers; a spreadsheet keeps 15 digits"
        )


def _on_a_path(table: CsvTable, ns: NDArray[np.int64], good: NDArray[np.bool_]) -> bool:
    """Whether rows of one stamp are nearer to one another than to those of the next: one object's, at several times.

    Several objects under one number are as far apart in each picture as they are, and each goes on from where it was.
    """
    pixels = np.column_stack([table.numbers("u_px"), table.numbers("v_px")])
    usable = good & np.isfinite(pixels).all(axis=1)
    order = np.flatnonzero(usable)[np.argsort(ns[usable], kind="stable")]
    frames = np.split(pixels[order], np.flatnonzero(np.diff(ns[order])) + 1)
    within = np.concatenate([np.linalg.norm(np.diff(one, axis=0), axis=1) for one in frames])
    across = [np.linalg.norm(one[:, None] - two[None], axis=2).min(axis=1) for one, two in pairwise(frames)]
    if not across or not len(within):
        return len(within) > 0
    return bool(np.median(within) <= np.median(np.concatenate(across)))


def tracks(table: CsvTable) -> NDArray[np.int64]:
    """(N,) track numbers, 0 where none is said; names get numbers that the file does not use otherwise.

    Only which are alike matters, so that what the wire has no room for, such as -1, is wrapped.
    """
    values = table.columns.get("track")
    if values is None:
        return np.zeros(len(table.lines), np.int64)
    try:
        found = [int(value) % TRACK_NUMBERS for value in values]
    except ValueError:
        found = _named([value.strip() for value in values])
    return np.array(found, np.int64)


def _named(values: list[str]) -> list[int]:
    numbers = {value: _whole(value) for value in dict.fromkeys(values)}
    taken = {number for number in numbers.values() if number is not None}
    free = (number for number in range(TRACK_NUMBERS // 2, TRACK_NUMBERS) if number not in taken)
    names = {value: next(free) if number is None else number for value, number in numbers.items()}
    return [names[value] for value in values]


def _whole(value: str) -> int | None:
    """The number that a text is, 0 for nothing said; None for a name."""
    if value.lower() in UNSAID:
        return 0
    try:
        number = Decimal(value.replace(",", "."))
    except InvalidOperation:
        return None
    small = number.is_finite() and abs(number) < TRACK_NUMBERS
    return int(number) % TRACK_NUMBERS if small and number == int(number) else None
