"""Messages on disk: a bounded SQLite file, oldest out first, that survives kill -9 and the power cut.

Write-ahead log with a full sync at every commit: what is committed is there after a power cut, and the spool commits
twice a second, not for every frame. A file that a dying card has garbled must not keep a camera from working: it is set
aside under another name, and a new one begun; so is one of another version, into which ours cannot be written.
"""

import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Final, NamedTuple

from edge.messages import SpooledEpoch

SPOOL_MODE: Final = 0o640  # of a file that is made: what a camera saw is not everybody's business
BUSY_TIMEOUT_S: Final = 2.0  # nobody else should have the file open; a backup tool may, briefly

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS rows (
    id INTEGER PRIMARY KEY, epoch INTEGER NOT NULL, seq INTEGER NOT NULL, t_unix_ns INTEGER NOT NULL,
    payload BLOB NOT NULL, UNIQUE (epoch, seq));
"""

_INSERT: Final = "INSERT OR IGNORE INTO rows (epoch, seq, t_unix_ns, payload) VALUES (?, ?, ?, ?)"


class StoredRow(NamedTuple):
    """One kept message."""

    epoch: int
    seq: int
    t_unix_ns: int
    payload: bytes


class SpoolStore:
    """The file. Used by one thread. Every method may raise sqlite3.Error: a full, read-only or dying disk."""

    def __init__(self, path: Path, *, max_bytes: int) -> None:
        """path: the file, made if missing. max_bytes: of messages kept; the file grows to about 1.2 times that."""
        self._max_bytes = max_bytes
        self._file = _open(path)
        self._bytes: int = self._file.execute("SELECT coalesce(sum(length(payload)), 0) FROM rows").fetchone()[0]

    def close(self) -> None:
        """Close the file; a closed store cannot be used again."""
        self._file.close()

    def add(self, rows: Iterable[StoredRow]) -> int:
        """Keep these rows, in one transaction; returns how many old ones had to go for them."""
        before = self._bytes
        try:
            with self._file:  # commits, or rolls back
                for row in rows:
                    if self._file.execute(_INSERT, row).rowcount == 1:
                        self._bytes += len(row.payload)
                return self._evict()
        except sqlite3.Error:
            self._bytes = before
            raise

    def _evict(self) -> int:
        evicted = 0
        while self._bytes > self._max_bytes:
            oldest = self._file.execute("SELECT id, length(payload) FROM rows ORDER BY id LIMIT 64").fetchall()
            if not oldest:
                break
            self._file.execute("DELETE FROM rows WHERE id <= ?", (oldest[-1][0],))
            self._bytes -= sum(size for _, size in oldest)
            evicted += len(oldest)
        return evicted

    def inventory(self) -> list[SpooledEpoch]:
        """What is kept of each run of the program, oldest run first."""
        found = self._file.execute(
            "SELECT epoch, min(seq), max(seq), count(*) FROM rows GROUP BY epoch ORDER BY min(id)"
        ).fetchall()
        return [SpooledEpoch(epoch=e, first_seq=first, last_seq=last, rows=n) for e, first, last, n in found]

    def rows(self, epoch: int, first_seq: int, last_seq: int) -> Sequence[StoredRow]:
        """What is kept of one run's sequence numbers first to last, in order."""
        return [
            StoredRow(*row)
            for row in self._file.execute(
                "SELECT epoch, seq, t_unix_ns, payload FROM rows WHERE epoch = ? AND seq BETWEEN ? AND ? ORDER BY seq",
                (epoch, first_seq, last_seq),
            )
        ]


def _open(path: Path) -> sqlite3.Connection:
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        return _connect(path)
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):  # read-only, full: nothing is wrong with the file itself
            raise
        for suffix in ("", "-wal", "-shm"):
            with suppress(FileNotFoundError):
                Path(f"{path}{suffix}").rename(f"{path}.garbled{suffix}")
        return _connect(path)


def _connect(path: Path) -> sqlite3.Connection:
    path.touch(SPOOL_MODE)
    file = sqlite3.connect(path, timeout=BUSY_TIMEOUT_S)
    try:
        file.execute("PRAGMA journal_mode = WAL")
        file.execute("PRAGMA synchronous = FULL")
        file.execute("PRAGMA journal_size_limit = 8388608")  # bytes: a burst must not leave a large log behind for ever
        with closing(file.execute("PRAGMA quick_check(1)")) as check:
            if check.fetchone()[0] != "ok":
                raise sqlite3.DatabaseError("the integrity check failed")
        file.executescript(_SCHEMA)
        _try(file)
    except sqlite3.Error:
        file.close()
        raise
    return file


def _try(file: sqlite3.Connection) -> None:
    """Raise DatabaseError if the table is another version's: one row is written, read, and taken back."""
    try:
        columns = {name for _, name, *_ in file.execute("PRAGMA table_info(rows)")}
        if not {"id", *StoredRow._fields} <= columns:
            raise sqlite3.DatabaseError("the table is of another version")
        file.execute("BEGIN")
        file.execute(_INSERT, StoredRow(-1, -1, 0, b""))
        if file.execute("SELECT count(*) FROM rows WHERE epoch = -1").fetchone() != (1,):
            raise sqlite3.DatabaseError("the table takes no rows of this version")
    except sqlite3.OperationalError:
        return  # a full or read-only disk says nothing of the table
    finally:
        file.rollback()
