"""The last two seconds of every camera's own tracks, as site times and pixels: what the guard looks at."""

from collections import defaultdict, deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.network import Camera, Network
from calib.observations import Frame
from edge.common.arrays import Array

KEEP_NS: Final = 2_000_000_000
MIN_ROWS: Final = 4
LEAST_TRACK_S: Final = 0.25  # s: shorter tracks are clutter, mostly
SAMPLES: Final = 6  # instants of a track that are looked at
LARGEST_GAP_S: Final = 0.25  # s between a track's rows, across which its pixel may be interpolated
MAX_ROWS: Final = 3000  # of a camera


@dataclass(frozen=True)
class RayTrack:
    """One camera's track: site times (N,), pixels (N, 2)."""

    label: int
    t_s: Array
    pixels: Array

    def at(self, t_s: Array) -> Array:
        """(M, 2) pixels at times (M,), NaN where the track does not reach or has a gap."""
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        gap = self.t_s[after] - self.t_s[after - 1]
        part = (t_s - self.t_s[after - 1]) / np.maximum(gap, 1e-9)
        pixels = self.pixels[after - 1] + (self.pixels[after] - self.pixels[after - 1]) * part[:, None]
        reached = (t_s >= self.t_s[0]) & (t_s <= self.t_s[-1]) & (gap < LARGEST_GAP_S)
        return np.where(reached[:, None], pixels, np.nan)


class RayTracks:
    """A short memory of frames, per camera."""

    def __init__(self) -> None:
        self._rows: defaultdict[str, deque[tuple[int, int, float, float]]] = defaultdict(lambda: deque(maxlen=MAX_ROWS))

    def add(self, frame: Frame) -> None:
        """Take a frame."""
        rows = self._rows[frame.camera]
        if rows and frame.t_unix_ns < rows[-1][0]:
            rows.clear()
        for label, (u, v) in zip(frame.label.tolist(), frame.pixels.tolist(), strict=True):
            rows.append((frame.t_unix_ns, label, u, v))
        while rows and rows[0][0] < frame.t_unix_ns - KEEP_NS:
            rows.popleft()

    def forget(self, camera: str) -> None:
        """Drop a camera's rows."""
        self._rows.pop(camera, None)

    def of(self, camera: Camera | None, network: Network, since_unix_ns: int = 0) -> list[RayTrack]:
        """A camera's tracks that are long enough to mean something."""
        assert camera is not None
        groups: defaultdict[int, list[tuple[int, float, float]]] = defaultdict(list)
        for t_unix_ns, label, u, v in self._rows.get(camera.id, ()):
            if t_unix_ns >= since_unix_ns:
                groups[label].append((t_unix_ns, u, v))
        return [
            track
            for label, rows in groups.items()
            if len(rows) >= MIN_ROWS and (track := _track(label, rows, camera, network)) is not None
        ]


def _track(label: int, rows: list[tuple[int, float, float]], camera: Camera, network: Network) -> RayTrack | None:
    stamps = np.array([row[0] for row in rows], np.int64)
    pixels = np.array([row[1:] for row in rows])
    t_s = camera.site_time_s(stamps, pixels[:, 1], network.t_mid_unix_ns)
    _, first = np.unique(t_s, return_index=True)  # two rows of one label in one frame: a box gone wrong
    if len(first) < MIN_ROWS or t_s[first[-1]] - t_s[first[0]] < LEAST_TRACK_S:
        return None
    return RayTrack(label, t_s[first], pixels[first])
