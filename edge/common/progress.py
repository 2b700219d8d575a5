"""A line that says how far a long command is, for whoever waits before a terminal; nobody reads it anywhere else."""

import sys
import time
from types import TracebackType
from typing import Final, Self, TextIO

BAR_WIDTH: Final = 30  # characters
DRAWN_EVERY_S: Final = 0.2


def write_over(line: str, out: TextIO) -> None:
    """Show a line in place of the one before, where somebody looks; an empty one takes it away."""
    if out.isatty():
        out.write(f"\r\x1b[K{line}")
        out.flush()


class Progress:
    """So much of `total` done; total 0 where nobody knows. Context manager: the line is gone when it is left."""

    def __init__(self, what: str, total: int, out: TextIO | None = None) -> None:
        self._what = what
        self._total = total
        self._out = out or sys.stderr
        self._began_s = self._drawn_s = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        write_over("", self._out)

    def at(self, done: int) -> None:
        """Show that so much is done, unless it was shown a moment ago."""
        now_s = time.monotonic()
        if now_s - self._drawn_s >= DRAWN_EVERY_S:
            self._drawn_s = now_s
            write_over(bar(self._what, done, self._total, now_s - self._began_s), self._out)


def bar(what: str, done: int, total: int, passed_s: float) -> str:
    """The line itself."""
    pace = f"{done / passed_s:.3g} a second" if passed_s > 0 else ""
    if total <= 0:
        return f"{what}: {done}, {pace}"
    share = min(1.0, done / total)
    filled = round(share * BAR_WIDTH)
    return f"{what}: [{'#' * filled}{'.' * (BAR_WIDTH - filled)}] {share:4.0%}, {done} of {total}, {pace}"
