"""The published gating rules, exactly, frame by frame (profile `paper`).

Rule 1: detections of frames i and j, i < j <= i + 3, less than 10 (j - i) pixels apart confirm each other. Rule 2:
between two confirmed detections up to 180 frames apart, both inside the middle 98 % of the image (or up to 60 frames
apart anywhere), and less than j - i times 2.5 times the largest non-outlier speed apart, the frames between are
interpolated.

So a detection may wait three frames for its confirmation, and what rule 2 adds comes late, marked as never measured.
The rules count frames and not seconds, and static clutter passes them; both are why they are not the default.
"""

from collections import deque
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from edge.common.arrays import Array
from edge.detector.detections import Detections
from edge.gate.rows import TrackRow, interpolate, rows_of

CONFIRM_FRAMES: Final = 3  # rule 1: the furthest partner
CONFIRM_PX: Final = 10.0  # rule 1: pixels per frame
BRIDGE_FRAMES: Final = 180  # rule 2: the longest gap inside the image
BRIDGE_ANYWHERE_FRAMES: Final = 60  # rule 2: the longest gap at its edge
EDGE_SHARE: Final = 0.01  # rule 2: of width or height
SPEED_MARGIN: Final = 2.5  # rule 2: times the largest non-outlier speed
OUTLIER_FENCE: Final = 1.5  # interquartile ranges above the upper quartile (Tukey 1977)
SPEEDS_KEPT: Final = 5000  # the last few minutes of flight


@dataclass
class _Seen:
    """A detection, and what has become of it."""

    index: int
    row: TrackRow
    confirmed: bool = False


class PaperGate:
    """Rules 1 and 2 over a stream of frames. size_px: width and height of the image."""

    def __init__(self, size_px: tuple[int, int]) -> None:
        self._size_px = size_px
        self._index = -1
        self._times: deque[int] = deque(maxlen=BRIDGE_FRAMES + 1)
        self._recent: deque[list[_Seen]] = deque(maxlen=CONFIRM_FRAMES)  # frames a new detection may still confirm
        self._tails: dict[int, _Seen] = {}  # the last confirmed detection of each track
        self._speeds: deque[float] = deque(maxlen=SPEEDS_KEPT)  # pixels per frame
        self.next_track = 1

    def step(self, t_unix_ns: int, found: Detections) -> list[TrackRow]:
        """Rows decided by one more frame."""
        self._index += 1
        self._times.append(t_unix_ns)
        now = [_Seen(self._index, row) for row in rows_of(t_unix_ns, found)]
        rows: list[TrackRow] = []
        taken: set[int] = set()
        for _, _, earlier, later in sorted(self._partners(now), key=lambda pair: pair[:2]):
            rows += self._confirm(earlier, later, taken)
        self._recent.append(now)
        oldest = self._index - BRIDGE_FRAMES
        self._tails = {track: seen for track, seen in self._tails.items() if seen.index >= oldest}
        return rows

    def _partners(self, now: list[_Seen]) -> list[tuple[int, float, _Seen, _Seen]]:
        """Rule 1: every pair that confirms each other, as (frames apart, pixels apart, earlier, later)."""
        return [
            (later.index - earlier.index, distance, earlier, later)
            for frame in self._recent
            for earlier in frame
            for later in now
            if (distance := _distance(earlier.row, later.row)) < CONFIRM_PX * (later.index - earlier.index)
        ]

    def _confirm(self, earlier: _Seen, later: _Seen, taken: set[int]) -> list[TrackRow]:
        """Confirm a pair, nearest pairs first: the later one continues the earlier one's track if it is still free."""
        rows: list[TrackRow] = []
        if not earlier.confirmed:
            rows += self._begin(earlier)
        if later.confirmed:
            return rows
        track = earlier.row.track
        if track in taken:
            return rows + self._begin(later)
        taken.add(track)
        later.confirmed, later.row = True, replace(later.row, track=track)
        self._speeds.append(_distance(earlier.row, later.row) / (later.index - earlier.index))
        rows += [*self._between(self._tails[track], later), later.row]
        self._tails[track] = later
        return rows

    def _begin(self, seen: _Seen) -> list[TrackRow]:
        """Confirm a detection that continues nothing under rule 1: rule 2 may tie it to the end of a track."""
        tail = self._bridge_from(seen)
        track = self._new_track() if tail is None else tail.row.track
        seen.confirmed, seen.row = True, replace(seen.row, track=track)
        rows = [] if tail is None else self._between(tail, seen)
        self._tails[track] = seen
        return [*rows, seen.row]

    def _bridge_from(self, seen: _Seen) -> _Seen | None:
        """Rule 2: the end of a track nearest in speed that this detection may continue."""
        speed_max = SPEED_MARGIN * largest_non_outlier(np.array(self._speeds))
        best, best_speed = None, np.inf
        for tail in self._tails.values():
            frames = seen.index - tail.index
            inside = self._inside(tail.row) and self._inside(seen.row)
            if not 1 < frames <= (BRIDGE_FRAMES if inside else BRIDGE_ANYWHERE_FRAMES):
                continue
            speed = _distance(tail.row, seen.row) / frames
            if speed < min(best_speed, speed_max):
                best, best_speed = tail, speed
        return best

    def _inside(self, row: TrackRow) -> bool:
        return all(
            EDGE_SHARE * length <= at <= (1 - EDGE_SHARE) * length
            for at, length in zip((row.u_px + 0.5, row.v_px + 0.5), self._size_px, strict=True)
        )

    def _between(self, tail: _Seen, later: _Seen) -> list[TrackRow]:
        first = len(self._times) - 1 - (self._index - tail.index)
        last = len(self._times) - 1 - (self._index - later.index)
        return interpolate(tail.row, later.row, list(self._times)[max(0, first + 1) : last])

    def _new_track(self) -> int:
        self.next_track += 1
        return self.next_track - 1

    def expected(self, t_unix_ns: int) -> Array:
        """Where each track of the last few frames was seen last."""
        recent = [tail.row for tail in self._tails.values() if self._index - tail.index <= CONFIRM_FRAMES]
        return np.array([(row.u_px, row.v_px, max(row.width_px, row.height_px)) for row in recent]).reshape(-1, 3)


def largest_non_outlier(speeds: Array) -> float:
    """The largest speed that Tukey's fence does not call an outlier; 0 of none."""
    if not speeds.size:
        return 0.0
    low, high = np.percentile(speeds, [25, 75])
    return float(speeds[speeds <= high + OUTLIER_FENCE * (high - low)].max(initial=0.0))


def _distance(one: TrackRow, other: TrackRow) -> float:
    return float(np.hypot(one.u_px - other.u_px, one.v_px - other.v_px))
