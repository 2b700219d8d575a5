"""CSV files with a header and `#` comments, by column name."""

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array
from edge.common.errors import SkyfixError


def read_table(path: Path, columns: tuple[str, ...]) -> dict[str, list[str]]:
    """Named columns of a CSV with a header and `#` comments. Raises SkyfixError naming what is missing."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SkyfixError(f"cannot be read ({error})", where=str(path), action="check the path") from error
    missing = [column for column in columns if not rows or rows[0].get(column) is None]
    if missing:
        raise SkyfixError(f"no column {missing[0]}", where=str(path), action=f"give a header with {','.join(columns)}")
    return {column: [row[column] for row in rows] for column in columns}


def numbers(path: Path, values: list[str]) -> Array:
    """(N,) finite numbers of a column. Raises SkyfixError for anything else."""
    try:
        found = np.array(values, float)
    except ValueError as error:
        raise SkyfixError(f"not a number ({error})", where=str(path), action="correct that row") from error
    if not np.all(np.isfinite(found)):
        raise SkyfixError("a number is not finite", where=str(path), action="remove that row")
    return found


def whole_numbers(path: Path, values: list[str]) -> NDArray[np.int64]:
    """(N,) whole numbers of a column: nanoseconds since 1970 do not fit a float. Raises SkyfixError."""
    try:
        return np.array([int(value) for value in values], np.int64)
    except (ValueError, OverflowError) as error:
        raise SkyfixError(f"not a whole number ({error})", where=str(path), action="correct that row") from error
