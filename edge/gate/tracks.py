"""Track confirmation: a track is confirmed that has been seen often enough and has gone somewhere.

On a static camera the false detections are static clutter, which any rule of the kind "again within ten pixels"
confirms. What tells an object from them is net movement; a drone that has moved once and then hovers stays confirmed.
And the detector is sure of an object in frame after frame, of a leaf only now and then: a track's mean score tells the
two apart where its best score does not.
Every limit is in seconds and pixels per second, so that a camera of another frame rate or one that drops frames is
gated the same way. When a track is confirmed, what it was seen as before is given too: those were measurements as well.
"""

import itertools
from collections import deque
from dataclasses import replace
from typing import Final

import numpy as np

from edge.common.arrays import Array
from edge.config import GateConfig
from edge.detector.detections import Detections
from edge.gate.clutter import ClutterMap
from edge.gate.rows import TrackRow, interpolate, rows_of
from edge.gate.track import HISTORY_S, SIGMA_UNKNOWN_PX, GateTrack

GATE_SIGMAS: Final = 4.0  # innovations beyond this are another object: 1 in 3000 of the true ones, in two dimensions
SLACK_PX: Final = 2.0  # a box detector's centre wanders by this much without saying so
WINDOW_SLACK: Final = 1.6  # times confirm_hits frames: 5 hits in 8 frames
TENTATIVE_GAP_S: Final = 0.3  # a tentative track not seen for so long is dropped
UNMOVED_S: Final = 3.0  # a tentative track that has gone nowhere for so long is clutter
# A false track hops among swaying leaves; what flies goes smoothly, as far as its detector can say.
MOVED_SIGMAS: Final = 6.0  # of the detector's own sigma: net movement that is no jitter
STEP_SHARE: Final = 0.4  # of the net movement: the most that one step may be, of the four there are at least
ROUGH_SIGMAS: Final = 1.5  # of the detector's own sigma
ROUGH_SHARE: Final = 0.04  # of the net movement
CLUTTER_FACTOR: Final = 4.0  # in a wholly cluttered place a track must move so many times further, and once more
FLOWN: Final = 4.0  # times moved_min_px from where it began: what went so far once may hover, what did not may not
CLUTTERED: Final = 0.3  # level of a place in which a confirmed track may not rest
SCORE_KEPT: Final = 0.85  # of the score that confirms a track: the least it must keep up over KEPT_S
KEPT_S: Final = 0.5  # s: a track that lost its object takes doubtful things for it; over 3 s that was 1 row in 30
KEPT_LOOKS: Final = 8  # at the least, where frames are few: the mean of less is chance
INSECT_LENGTHS_S: Final = 100.0  # of its own a second: a drone of 35 cm at 35 m/s; faster is an insect near the lens
WAITING_S: Final = 1.0  # how much of its tentative past a track gives when it is confirmed
SIZE_RATIO_MAX: Final = 3.0  # a box three times as large is another object
STATIC_CROPS: Final = 4  # places of tentative, unmoved tracks worth a look a frame: clutter must not eat the budget


class TrackGate:
    """Tracks over a stream of frames. size_px: width and height of the image."""

    def __init__(self, size_px: tuple[int, int], config: GateConfig, track_score: float) -> None:
        self._config = config
        self._score_least = track_score if config.score_confirm is None else config.score_confirm
        self._score_kept = SCORE_KEPT * self._score_least
        self._size_px = size_px
        self._clutter = ClutterMap(size_px)
        self._tracks: list[GateTrack] = []
        self._times: deque[int] = deque()
        self.next_track = 1

    def step(self, t_unix_ns: int, found: Detections) -> list[TrackRow]:
        """Rows decided by one more frame."""
        if self._times and t_unix_ns <= self._times[-1]:
            return []  # time does not go backwards within a segment; whoever feeds us counts this
        self._times.append(t_unix_ns)
        while self._times[0] < t_unix_ns - HISTORY_S * 1e9:
            self._times.popleft()
        measured = rows_of(t_unix_ns, found)
        rows: list[TrackRow] = []
        for track, row in self._associate(t_unix_ns, measured):
            rows += self._continue(track, row)
        self._drop(t_unix_ns)
        return rows

    def _associate(self, t_unix_ns: int, measured: list[TrackRow]) -> list[tuple[GateTrack, TrackRow]]:
        """Data association: the nearest pairs first, confirmed tracks before others; the rest begin new tracks."""
        pairs = sorted(
            (not self._tracks[i].confirmed, cost, i, k)
            for i, k in self._near(t_unix_ns, measured)
            if (cost := self._cost(self._tracks[i], measured[k])) is not None
        )
        tracks, rows = set(range(len(self._tracks))), set(range(len(measured)))
        matched = []
        for _, _, i, k in pairs:
            if i in tracks and k in rows:
                tracks.discard(i)
                rows.discard(k)
                matched.append((self._tracks[i], measured[k]))
        for k in sorted(rows):
            self._begin(measured[k])
        return matched

    def _near(self, t_unix_ns: int, measured: list[TrackRow]) -> list[tuple[int, int]]:
        """Pairs of a track and a row that the limit of speed does not rule out; most deserve no closer look."""
        if not (self._tracks and measured):
            return []
        rows = np.array([(row.u_px, row.v_px) for row in measured])
        tracks = np.array([track.predict(t_unix_ns) for track in self._tracks])
        silent_s = np.array([(t_unix_ns - track.t_unix_ns) / 1e9 for track in self._tracks])
        reach_px = self._config.speed_max_px_s * silent_s + SLACK_PX
        away_px = np.abs(tracks[:, None, :2] - rows[None]).max(axis=2)
        return [(int(i), int(k)) for i, k in zip(*np.nonzero(away_px <= reach_px[:, None]), strict=True)]

    def _cost(self, track: GateTrack, row: TrackRow) -> float | None:
        """Squared distance in sigmas, None if the row cannot be this track's."""
        u, v, var = track.predict(row.t_unix_ns)
        squared = (row.u_px - u) ** 2 + (row.v_px - v) ** 2
        var += (row.sigma_px or SIGMA_UNKNOWN_PX) ** 2
        dt = (row.t_unix_ns - track.t_unix_ns) / 1e9
        reach_px = min(GATE_SIGMAS * var**0.5, self._config.speed_max_px_s * dt) + SLACK_PX
        ratio = max(row.width_px, row.height_px, 1.0) / max(track.last.width_px, track.last.height_px, 1.0)
        if squared > reach_px**2 or not 1 / SIZE_RATIO_MAX <= ratio <= SIZE_RATIO_MAX:
            return None
        return squared / var

    def _begin(self, row: TrackRow) -> None:
        level = self._clutter.level(row.u_px, row.v_px)
        track = GateTrack(self.next_track, row, self._config.speed_max_px_s / 3, clutter=level)
        track.waiting.append(replace(row, track=track.number))
        self.next_track += 1
        self._tracks.append(track)

    def _continue(self, track: GateTrack, measured: TrackRow) -> list[TrackRow]:
        """Take a measurement into a track; the rows that are thereby decided."""
        before = track.last
        track.update(measured)
        row = replace(measured, track=track.number, classes=track.class_scores())
        if track.confirmed:
            return [] if self._has_faded(track) else [*self._bridge(replace(before, track=track.number), row), row]
        track.waiting.append(row)
        track.waiting = [kept for kept in track.waiting if kept.t_unix_ns >= row.t_unix_ns - WAITING_S * 1e9]
        if not self._believable(track):
            return []
        track.confirmed = True
        rows, track.waiting = track.waiting, []
        bridged = [new for a, b in itertools.pairwise(rows) for new in self._bridge(a, b)]
        return sorted(rows + bridged, key=lambda kept: kept.t_unix_ns)

    def _believable(self, track: GateTrack) -> bool:
        now, config = track.t_unix_ns, self._config
        window_ns = max(config.confirm_window_s * 1e9, WINDOW_SLACK * config.confirm_hits * self._interval_ns())
        since = round(now - config.moved_window_s * 1e9)
        seen = track.hits_since(round(now - window_ns)) >= config.confirm_hits and not self._has_faded(track)
        if not seen or track.mean_score(since) < self._score_least or track.lengths_s() > INSECT_LENGTHS_S:
            return False
        enough_px = config.moved_min_px * (1 + CLUTTER_FACTOR * track.clutter)
        moved_px, sigma_px = track.moved_px(since), track.sigma_px(since)
        if moved_px < max(enough_px, MOVED_SIGMAS * sigma_px):
            return False
        even = track.largest_step_px(since) <= STEP_SHARE * moved_px + sigma_px
        return even and track.roughness_px(since) <= max(ROUGH_SIGMAS * sigma_px, ROUGH_SHARE * moved_px)

    def _interval_ns(self) -> float:
        return (self._times[-1] - self._times[0]) / max(1, len(self._times) - 1)

    def _bridge(self, before: TrackRow, after: TrackRow) -> list[TrackRow]:
        """Rows between two measurements, if they are near in time and neither is so doubtful that it may be a leap."""
        doubtful = min(before.score, after.score) < self._score_kept
        if doubtful or after.t_unix_ns - before.t_unix_ns > self._config.bridge_max_s * 1e9:
            return []
        return interpolate(before, after, [t for t in self._times if before.t_unix_ns < t < after.t_unix_ns])

    def _drop(self, now_unix_ns: int) -> None:
        kept = []
        for track in self._tracks:
            silent_s = (now_unix_ns - track.t_unix_ns) / 1e9
            if now_unix_ns - track.born_unix_ns > UNMOVED_S * 1e9 and self._is_clutter(track):
                self._clutter.add(track.last.u_px, track.last.v_px, now_unix_ns)
            elif silent_s <= (self._config.coast_max_s if track.confirmed else TENTATIVE_GAP_S):
                kept.append(track)
        self._tracks = kept

    def _has_faded(self, track: GateTrack) -> bool:
        """Whether its object may have gone: what is taken for it of late is doubtful. Its rows wait until it is not."""
        return track.late_score(KEPT_S, KEPT_LOOKS) < self._score_kept

    def _is_clutter(self, track: GateTrack) -> bool:
        """An old track not confirmed, hardly seen any more, or that rests among clutter or without having flown far."""
        if not track.confirmed or track.mean_score(track.places[0].t_unix_ns) < self._score_kept:
            return True
        moved_px, least_px = track.moved_px(track.places[0].t_unix_ns), self._config.moved_min_px
        if track.reach_px < FLOWN * least_px and moved_px < least_px:
            return True
        cluttered = self._clutter.level(track.last.u_px, track.last.v_px) >= CLUTTERED
        return cluttered and moved_px < least_px * (1 + CLUTTER_FACTOR)

    def expected(self, t_unix_ns: int) -> Array:
        """Where the tracks should be: confirmed ones, then those seen twice, of the cluttered ones only a few."""
        confirmed = [track for track in self._tracks if track.confirmed]
        others = [track for track in self._tracks if not track.confirmed and len(track.places) > 1]
        others.sort(key=lambda track: (track.clutter, -track.best_score))
        rows = []
        for track in confirmed + others[:STATIC_CROPS]:
            u, v, _ = track.predict(t_unix_ns)
            if 0 <= u < self._size_px[0] and 0 <= v < self._size_px[1]:
                rows.append((u, v, max(track.last.width_px, track.last.height_px)))
        return np.array(rows).reshape(-1, 3)
