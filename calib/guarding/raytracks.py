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
HALF_NORMAL: Final = 0.6745  # median of the absolute value of a normal deviate


@dataclass(frozen=True)
class RayTrack:
    """One camera's track: site times (N,), pixels (N, 2), width_px of its box, NaN if nobody says."""

    label: int
    t_s: Array
    pixels: Array
    width_px: float = np.nan

    def at(self, t_s: Array) -> Array:
        """(M, 2) pixels at times (M,), NaN where the track does not reach or has a gap."""
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        gap = self.t_s[after] - self.t_s[after - 1]
        part = (t_s - self.t_s[after - 1]) / np.maximum(gap, 1e-9)
        pixels = self.pixels[after - 1] + (self.pixels[after] - self.pixels[after - 1]) * part[:, None]
        reached = (t_s >= self.t_s[0]) & (t_s <= self.t_s[-1]) & (gap < LARGEST_GAP_S)
        return np.where(reached[:, None], pixels, np.nan)

    @property
    def velocity_px_s(self) -> Array:
        """(2,) mean velocity in the image."""
        velocity: Array = (self.pixels[-1] - self.pixels[0]) / (self.t_s[-1] - self.t_s[0])
        return velocity

    @property
    def rough_px(self) -> float:
        """One sigma of the noise that is new in every row, by how far rows lie from the line of their neighbours."""
        t_s, before = self.t_s, np.diff(self.t_s)
        share = (before[:-1] / (t_s[2:] - t_s[:-2]))[:, None]
        bend = self.pixels[1:-1] - self.pixels[:-2] * (1 - share) - self.pixels[2:] * share
        return float(np.median(np.abs(bend) / np.sqrt(1 + share**2 + (1 - share) ** 2))) / HALF_NORMAL

    @property
    def every_s(self) -> float:
        """Mean time between rows."""
        return float(self.t_s[-1] - self.t_s[0]) / (len(self.t_s) - 1)


class RayTracks:
    """A short memory of frames, per camera."""

    def __init__(self) -> None:
        self._rows: defaultdict[str, deque[tuple[int, int, float, float, float]]] = defaultdict(
            lambda: deque(maxlen=MAX_ROWS)
        )
        self.newest_ns: dict[str, int] = {}  # stamp of each camera's newest frame, with or without objects

    def add(self, frame: Frame) -> None:
        """Take a frame."""
        rows = self._rows[frame.camera]
        self.newest_ns[frame.camera] = frame.t_unix_ns
        if rows and frame.t_unix_ns < rows[-1][0]:
            rows.clear()
        width = [np.nan] * len(frame.label) if frame.width_px is None else frame.width_px.tolist()
        for label, (u, v), width_px in zip(frame.label.tolist(), frame.pixels.tolist(), width, strict=True):
            rows.append((frame.t_unix_ns, label, u, v, width_px))
        while rows and rows[0][0] < frame.t_unix_ns - KEEP_NS:
            rows.popleft()

    def forget(self, camera: str) -> None:
        """Drop a camera's rows."""
        self._rows.pop(camera, None)

    def of(self, camera: Camera | None, network: Network, since_unix_ns: int = 0) -> list[RayTrack]:
        """A camera's tracks that are long enough to mean something."""
        assert camera is not None
        groups: defaultdict[int, list[tuple[int, float, float, float]]] = defaultdict(list)
        for t_unix_ns, label, u, v, width_px in self._rows.get(camera.id, ()):
            if t_unix_ns >= since_unix_ns:
                groups[label].append((t_unix_ns, u, v, width_px))
        return [
            track
            for label, rows in groups.items()
            if len(rows) >= MIN_ROWS and (track := _track(label, rows, camera, network)) is not None
        ]


def _track(
    label: int, rows: list[tuple[int, float, float, float]], camera: Camera, network: Network
) -> RayTrack | None:
    stamps = np.array([row[0] for row in rows], np.int64)
    pixels = np.array([row[1:] for row in rows])
    t_s = camera.site_time_s(stamps, pixels[:, 1], network.t_mid_unix_ns)
    _, first = np.unique(t_s, return_index=True)  # two rows of one label in one frame: a box gone wrong
    if len(first) < MIN_ROWS or t_s[first[-1]] - t_s[first[0]] < LEAST_TRACK_S:
        return None
    return RayTrack(label, t_s[first], pixels[first, :2], float(np.median(pixels[:, 2])))
