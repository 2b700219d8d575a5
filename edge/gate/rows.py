"""What gating gives: rows of tracks, some of them about frames that have already passed."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from edge.common.arrays import Array
from edge.detector.detections import Detections


@dataclass(frozen=True)
class TrackRow:
    """One object in one frame. Interpolated rows were never measured and carry no sigma."""

    t_unix_ns: int
    track: int
    u_px: float
    v_px: float
    width_px: float
    height_px: float
    score: float
    status: Literal["confirmed", "interpolated"]
    sigma_px: float | None = None
    classes: tuple[float, ...] = ()


class Gate(Protocol):
    """Decides which detections are objects and which objects are the same. Has no clock: times are handed in."""

    next_track: int
    """The number the next track will get."""

    def step(self, t_unix_ns: int, found: Detections) -> list[TrackRow]:
        """Rows that one more frame decided, of this frame or earlier ones. Frames come in order of time."""

    def expected(self, t_unix_ns: int) -> Array:
        """Where to look for what is known: `(M, 3)` of u, v, extent, the most important first."""


def interpolate(before: TrackRow, after: TrackRow, times_unix_ns: list[int]) -> list[TrackRow]:
    """Rows at times between two rows of a track, on the straight line between them."""
    rows = []
    for t in times_unix_ns:
        share = (t - before.t_unix_ns) / (after.t_unix_ns - before.t_unix_ns)
        u, v, width, height = (
            getattr(before, name) + share * (getattr(after, name) - getattr(before, name))
            for name in ("u_px", "v_px", "width_px", "height_px")
        )
        score = min(before.score, after.score)
        rows.append(TrackRow(t, after.track, u, v, width, height, score, "interpolated", classes=after.classes))
    return rows


def rows_of(t_unix_ns: int, found: Detections) -> list[TrackRow]:
    """The detections of one frame as rows without a track."""
    return [
        TrackRow(
            t_unix_ns,
            0,
            float(found.centre_px[k, 0]),
            float(found.centre_px[k, 1]),
            float(found.size_px[k, 0]),
            float(found.size_px[k, 1]),
            float(found.score[k]),
            "confirmed",
            float(found.sigma_px[k]) if np.isfinite(found.sigma_px[k]) else None,
            tuple(map(float, found.classes[k])),
        )
        for k in range(len(found))
    ]
