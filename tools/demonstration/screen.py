"""What the terminal shows while the demo runs: every part's state, and why.

On a terminal one block of lines is redrawn in place; into a pipe, or on a terminal that cannot move its cursor, a line
is written whenever something changes, and every few seconds what the targets do.
"""

import os
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TextIO

import numpy as np

from tools.demonstration.listener import Position

SIGNS: Final = {"ok": "ok  ", "warn": "warn", "fail": "FAIL"}
PLAIN_EVERY_S: Final = 5.0  # s between lines about targets where lines are only appended
RECENT_NS: Final = 1_000_000_000


@dataclass(frozen=True)
class View:
    """All that is shown at one instant. errors_m: of `positions`, to the nearest object."""

    elapsed_s: float
    duration_s: float
    status: dict[str, Any] | None
    positions: Sequence[Position]
    errors_m: np.ndarray
    now_unix_ns: int


def lines(view: View) -> list[str]:
    """The block, as lines of any width."""
    found = [_clock(view)]
    if view.status is None:
        return [*found, "  base    starting"]
    found.append(f"  base    {view.status['phase']}: {view.status['reason']}")
    if view.status["action"]:
        found.append(f"          -> {view.status['action']}")
    found += [_camera(camera) for camera in view.status["cameras"]]
    found += _troubles(view.status)
    return found + _targets(view)


def _clock(view: View) -> str:
    if view.elapsed_s < 0:
        return f"the flight begins in {-view.elapsed_s:.0f} s"
    return f"flight {view.elapsed_s:5.1f} of {view.duration_s:.0f} s"


def _camera(camera: dict[str, Any]) -> str:
    parts = [
        "frames" if camera["online"] else "no frames yet" if camera["last_frame_s"] is None else "silent",
        f"{camera['detections_per_frame']:.1f} objects a frame",
        "surveyed" if camera["surveyed"] else "waiting for its RTK position",
        "calibrated" if camera["calibrated"] else camera["suspect"] or "not calibrated",
    ]
    return f"  {camera['id']}    {', '.join(parts)}"


def _troubles(status: dict[str, Any]) -> list[str]:
    """What health says beside what is shown anyway."""
    items = [item for item in status["health"]["items"] if item["level"] != "ok" and item["name"] != "calibration"]
    return [f"  {SIGNS[item['level']]}    {item['name']}: {item['reason']}" for item in items[:4]]


def _targets(view: View) -> list[str]:
    """One line for each track heard within the last second, as the MAVLink listener heard it."""
    latest: dict[int, int] = {}
    for k in range(len(view.positions) - 1, -1, -1):
        if view.now_unix_ns - view.positions[k].received_ns > RECENT_NS:
            break
        latest.setdefault(view.positions[k].track, k)
    rows = [(view.positions[k], float(view.errors_m[k])) for k in sorted(latest.values())]
    if not rows:
        return [f"  MAVLink nothing now, {len(view.positions)} positions so far"]
    total = f"{len(view.positions)} positions so far"
    return [
        f"  MAVLink target {p.track}: {p.cameras} cameras, {error:5.2f} m from the truth; {total}" for p, error in rows
    ]


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
            self._redraw(lines(view))
        else:
            self._append(view)

    def _redraw(self, block: list[str]) -> None:
        width = shutil.get_terminal_size().columns
        up = f"\x1b[{self._height}A" if self._height else ""
        self.stream.write(up + "".join(f"\x1b[2K{line[: width - 1]}\n" for line in block) + "\x1b[J")
        self.stream.flush()
        self._height = len(block)

    def _append(self, view: View) -> None:
        clock, *rest = lines(view)
        for line in rest:
            # What a line is about, and what it says without its numbers: only other words are news.
            subject, words = line[:10], "".join(c for c in line if not c.isdigit())
            quiet = "->" in line or "MAVLink" in line
            due = view.elapsed_s >= self._plain_due_s and "MAVLink" in line
            if due or (not quiet and self._said.get(subject) != words):
                self.stream.write(f"{clock}: {line.strip()}\n")
                self._said[subject] = words
        if view.elapsed_s >= self._plain_due_s:
            self._plain_due_s = view.elapsed_s + PLAIN_EVERY_S
        self.stream.flush()
