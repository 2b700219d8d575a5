"""CSV files with a header and `#` comments, by column name, as spreadsheets, other programs and people write them.

The hazard is the dialect: a file that a spreadsheet has saved once begins with an invisible mark, has semicolons for
commas and commas for points, ends its lines its own way and keeps empty ones. None of that changes what it says, so it
is read. What cannot be told (a comma that groups thousands or parts decimals) is refused, and every fault is named with
the line of the file at which an editor shows it.
"""

import codecs
import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array
from edge.common.errors import ConfigError, SkyfixError

SEPARATORS: Final = ",;\t"
UNSAID: Final = frozenset(("", "nan", "na", "n/a", "#n/a", "null", "none", "nil", "nat", "-"))  # written for no value
_LINE_END: Final = re.compile(r"\r\n|\r|\n")
_TOLD_SEPARATOR: Final = re.compile(r"sep=(.)\s*", re.IGNORECASE)  # a spreadsheet's own first line
_GROUPED: Final = re.compile(r"\d{1,3}(,\d{3})+")  # 1,234: which of the two?
_MARKS: Final = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


@dataclass(frozen=True)
class CsvFile:
    """A file, and the kind of error that is raised about it."""

    path: Path
    error: type[SkyfixError]

    def fault(self, what: str, action: str, line: int | None = None) -> SkyfixError:
        """What is wrong in it, to raise."""
        return self.error(what, where=f"{self.path}" if line is None else f"{self.path}, line {line}", action=action)


@dataclass(frozen=True)
class CsvTable:
    """A file's rows. columns: values as written, by lower-case name, all of one length; lines: (N,) of the file.

    separator: between its values. Programs that separate by something else than the comma mean the decimal one.
    """

    source: CsvFile
    columns: dict[str, list[str]]
    lines: list[int]
    separator: str

    def fault(self, row: int, what: str, action: str) -> SkyfixError:
        """What is wrong in a row, to raise."""
        return self.source.fault(what, action, self.lines[row])

    def numbers(self, column: str) -> Array:
        """(N,) of a column, nan where nothing is said. Raises the source's error for a value that is no number."""
        values = self.decimals(column)
        try:
            return np.array(list(map(float, values)), np.float64)
        except ValueError:
            return np.array([self._number(row, column, value) for row, value in enumerate(values)], np.float64)

    def finite(self, column: str) -> Array:
        """(N,) finite numbers of a column. Raises the source's error for anything else."""
        found = self.numbers(column)
        bad = np.flatnonzero(~np.isfinite(found))
        if len(bad):
            raise self.fault(
                int(bad[0]), f"{column}: {self.columns[column][bad[0]]!r} is not finite", "remove that row"
            )
        return found

    def whole(self, column: str) -> NDArray[np.int64]:
        """(N,) whole numbers of a column: nanoseconds since 1970 do not fit a float. Raises the source's error."""
        values = self.columns[column]
        try:
            return np.array(list(map(int, values)), np.int64)
        except (ValueError, OverflowError) as error:
            row = next(row for row, value in enumerate(values) if not _fits(value))
            raise self.fault(row, f"{column}: {values[row]!r} is not a whole number", "correct that row") from error

    def _number(self, row: int, column: str, value: str) -> float:
        try:
            return np.nan if value.strip().lower() in UNSAID else float(value)
        except ValueError as error:
            raise self.fault(row, f"{column}: {value!r} is no number", "give numbers") from error

    def decimals(self, column: str) -> list[str]:
        """A column's values with points for decimal commas. Raises the source's error where the comma may be either."""
        values = self.columns[column]
        joined = "\n".join(values)
        if "_" in joined:
            row = next(row for row, value in enumerate(values) if "_" in value)
            raise self.fault(row, f"{column}: {values[row]!r} is no number", "give numbers")
        if "," not in joined:
            return values
        grouped = self.separator == "," and all(_GROUPED.fullmatch(v.strip()) for v in values if "," in v)
        if grouped or "." in joined:
            row = next(row for row, value in enumerate(values) if "," in value)
            what = f"{column}: {values[row]!r} may have a decimal comma or a comma between thousands"
            raise self.fault(row, what, "write the numbers with a decimal point and without commas")
        return [value.replace(",", ".") for value in values]


def _fits(value: str) -> bool:
    try:
        return -(2**63) <= int(value) < 2**63
    except ValueError:
        return False


def read(path: Path, needed: tuple[str, ...], error: type[SkyfixError] = ConfigError) -> CsvTable:
    """A CSV file with at least the columns `needed`, whatever its dialect.

    Raises `error`, naming file, line and what to do.
    """
    source, separator = CsvFile(path, error), ""
    rows = iter(_lines(source))
    give = f"begin with a header of at least {','.join(needed)}"
    for number, text in rows:
        if told := _TOLD_SEPARATOR.fullmatch(text):
            separator = told[1]
            continue
        separator = separator or max(SEPARATORS, key=text.count)
        header = _header(source, number, text, separator)
        for name in needed:
            if name not in header:
                raise source.fault(f"no column {name}; line {number} has {', '.join(header)[:100]}", give)
        return _body(source, header, list(rows), separator)
    raise source.fault(f"no column {needed[0]}; it is empty", give)


def _lines(source: CsvFile) -> Iterator[tuple[int, str]]:
    """Lines that say something, with their numbers, counted from 1 as editors count them."""
    for number, line in enumerate(_LINE_END.split(_text(source)), start=1):
        if line.strip(" ,;\t\x1a") and not line.lstrip().startswith("#"):
            yield number, line


def _text(source: CsvFile) -> str:
    action = "save it as CSV in UTF-8"
    try:
        data = source.path.read_bytes()
    except OSError as error:
        raise source.fault(f"cannot be read ({error})", "give a readable CSV file") from error
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), "utf-8")
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        line = 1 + data[: error.start].replace(b"\r\n", b"\n").replace(b"\r", b"\n").count(b"\n")
        raise source.fault(f"is not text in UTF-8 ({error.reason})", action, line) from error
    if "\0" in text:
        raise source.fault("is no text: it holds zero bytes", action)
    return text


def _header(source: CsvFile, number: int, text: str, separator: str) -> list[str]:
    header = [name.strip().lower() for _, row in _split(source, [(number, text)], separator) for name in row]
    while header and not header[-1]:
        header.pop()
    twice = next((name for name in header if name and header.count(name) > 1), None)
    if twice is not None:
        raise source.fault(f"two columns are named {twice}", "give each a name of its own", number)
    return header


def _body(source: CsvFile, header: list[str], lines: list[tuple[int, str]], separator: str) -> CsvTable:
    numbers, rows = [], []
    width = len(header)
    for number, row in _split(source, lines, separator):
        if len(row) < width or any(value.strip() for value in row[width:]):
            raise source.fault(f"has {len(row)} of {width} columns", "complete or delete it", number)
        numbers.append(number)
        rows.append(row[:width])
    for k in reversed(range(len(rows))):
        if (
            rows[k][0].strip().lower() == header[0] and [value.strip().lower() for value in rows[k]] == header
        ):  # files that were put behind one another
            del rows[k], numbers[k]
    columns = [list(column) for column in zip(*rows, strict=True)] if rows else [[] for _ in header]
    return CsvTable(source, dict(zip(header, columns, strict=True)), numbers, separator)


def _split(source: CsvFile, lines: list[tuple[int, str]], separator: str) -> Iterator[tuple[int, list[str]]]:
    """The values of each line. Raises the source's error for a quotation mark that is not closed in its line."""
    if not any('"' in text for _, text in lines):
        for number, text in lines:
            yield number, text.split(separator)
        return
    reader = csv.reader((text for _, text in lines), delimiter=separator, skipinitialspace=True, strict=True)
    action = "correct its quotation marks"
    for taken, (number, _) in enumerate(lines, start=1):
        try:
            row, ended = next(reader), reader.line_num
        except (csv.Error, StopIteration) as error:
            raise source.fault("a quotation mark is not closed, or closed too early", action, number) from error
        if ended != taken:
            raise source.fault("a quotation mark is not closed in its line", action, number)
        yield number, row
