"""What the terminal shows while the demo runs: every part's state, and why.

On a terminal one block of lines is redrawn in place; into a pipe, or on a terminal that cannot move its cursor, a line
is written whenever something changes, and every few seconds what the targets do.
"""

import os
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, TextIO

import numpy as np

from tools.doubles.listener import Position

SIGNS: Final = ("ok", "warn", "fail")  # health levels
MOST_TROUBLES: Final = 4  # lines of troubles shown at once
MOST_TARGETS: Final = 8
PLAIN_EVERY_S: Final = 5.0  # s between lines about targets where lines are only appended
RECENT_NS: Final = 1_000_000_000


@dataclass(frozen=True)
class View:
    """All that is shown at one instant. errors_m: of `positions`, to the object each follows."""

    elapsed_s: float
    duration_s: float
    status: dict[str, Any] | None
    positions: Sequence[Position]
    errors_m: np.ndarray
    now_unix_ns: int


class Line(NamedTuple):
    """One line: what it is about, what it says, and whether new words in it are worth a line of their own."""

    subject: str
    text: str
    news: bool = True


def lines(view: View) -> list[Line]:
    """The block below the clock."""
    if view.status is None:
        return [Line("base", "starting")]
    found = [Line("base", f"{view.status['phase']}: {view.status['reason']}")]
    if view.status["action"]:
        found.append(Line("", f"-> {view.status['action']}", news=False))
    found += [_camera(camera) for camera in view.status["cameras"]]
    return found + _troubles(view.status) + _targets(view)


def clock(view: View) -> str:
    """Where in the flight we are."""
    if view.elapsed_s < 0:
        return f"the flight begins in {-view.elapsed_s:.0f} s"
    return f"{min(view.elapsed_s, view.duration_s):4.1f} of {view.duration_s:.0f} s"


def _camera(camera: dict[str, Any]) -> Line:
    parts = [
        "frames come" if camera["online"] else "no frame yet" if camera["last_frame_s"] is None else "silent",
        f"{camera['detections_per_frame']:.1f} objects a frame",
        "surveyed" if camera["surveyed"] else "waiting for its RTK position",
        "calibrated" if camera["calibrated"] else camera["suspect"] or "not calibrated",
    ]
    return Line(camera["id"], ", ".join(parts))


def _troubles(status: dict[str, Any]) -> list[Line]:
    """What health says beside what is shown anyway."""
    items = [item for item in status["health"]["items"] if item["level"] != "ok" and item["name"] != "calibration"]
    return [Line(item["level"], f"{item['name']}: {item['reason']}") for item in items[:MOST_TROUBLES]]


def _targets(view: View) -> list[Line]:
    """One line for each track heard within the last second, as the MAVLink listener heard it."""
    latest: dict[int, int] = {}
    for k in range(len(view.positions) - 1, -1, -1):
        if view.now_unix_ns - view.positions[k].received_ns > RECENT_NS:
            break
        latest.setdefault(view.positions[k].track, k)
    rows = [(view.positions[k], float(view.errors_m[k])) for k in latest.values()]
    rows.sort(key=lambda row: row[0].track)
    total = f"{len(view.positions)} positions so far"
    if not rows:
        return [Line("MAVLink", f"no target now, {total}", news=False)]
    return [
        Line("MAVLink", f"target {p.track}: seen by {p.cameras} cameras, {_off(error)}; {total}", news=False)
        for p, error in rows[:MOST_TARGETS]
    ]


def _off(error_m: float) -> str:
    return f"{error_m:.2f} m from the truth" if np.isfinite(error_m) else "its flight is over"


@dataclass
class Screen:
    """Shows views on a stream."""

    stream: TextIO = sys.stdout
    _height: int = 0
    _said: dict[str, str] = field(default_factory=dict)
    _plain_due_s: float = -1e9

    @property
    def can_redraw(self) -> bool:
        """Whether the cursor can be moved."""
        return self.stream.isatty() and os.environ.get("TERM", "dumb") != "dumb"

    def show(self, view: View) -> None:
        """Show this view in place of the last one, or what is new in it."""
        if self.can_redraw:
            self._redraw([clock(view), *(f"  {line.subject:8s}{line.text}" for line in lines(view))])
        else:
            self._append(view)
        self.stream.flush()

    def _redraw(self, block: list[str]) -> None:
        width = shutil.get_terminal_size().columns
        up = f"\x1b[{self._height}A" if self._height else ""
        self.stream.write(up + "".join(f"\x1b[2K{line[: width - 1]}\n" for line in block) + "\x1b[J")
        self._height = len(block)

    def _append(self, view: View) -> None:
        due = view.elapsed_s >= self._plain_due_s
        for line in lines(view):
            # Numbers change all the time; only other words are news, and of a trouble only that it is there.
            words = "".join(c for c in line.text if not c.isdigit())
            subject = line.subject if line.subject not in SIGNS else line.text.partition(":")[0]
            if (line.news and self._said.get(subject) != words) or (due and line.subject == "MAVLink"):
                self.stream.write(f"{clock(view)}: {line.subject} {line.text}\n")
                self._said[subject] = words
        if due:
            self._plain_due_s = view.elapsed_s + PLAIN_EVERY_S
