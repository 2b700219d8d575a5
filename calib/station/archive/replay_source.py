"""Track folders and recordings as streams of messages, in the order and with the stamps of the original.

The hazard is a replay that helps: one that waits, sorts or leaves out what a real site would not. A recording is
therefore played byte by byte in the order of arrival; a track folder becomes what its boxes would have sent, silence
included, for a camera that sees nothing says so once a second.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.geodesy import enu_to_geodetic
from calib.observations import Observations, Scene, SiteCamera
from calib.station.archive import recording, trackfolder
from edge.common.arrays import Array
from edge.common.errors import RecordingError
from edge.lens import pixel_to_ray
from edge.messages import Detection, Fix, Lens, Tracks, camera_of_key, encode

SILENCE_NS: Final = 1_000_000_000  # a camera that sees nothing says so this often
STATES: Final = ("lens", "fix")  # topics that late joiners are told too
PLAYED: Final = ("tracks", "lens", "fix", "health")


@dataclass(frozen=True)
class Said:
    """One message: when to say it (ns of the source's own time), its camera, topic and bytes."""

    t_ns: int
    camera: str
    topic: str
    payload: bytes


@dataclass(frozen=True)
class ReplaySource:
    """What can be played: the site, its cameras, and how long it lasts."""

    site: str
    cameras: tuple[str, ...]
    path: Path
    scene: Scene | None = None

    def messages(self, epoch: int) -> Iterator[Said]:
        """All messages in order. epoch: of made-up ones; recorded ones keep theirs."""
        return _of_recording(self.path) if self.scene is None else _of_scene(self.scene, epoch)


def open_source(path: Path) -> ReplaySource:
    """A track folder or a recording. Raises ConfigError or RecordingError naming what is wrong with it."""
    if path.is_dir():
        scene = trackfolder.load(path)
        return ReplaySource(scene.site, tuple(camera.id for camera in scene.cameras), path, scene)
    keys = {message.key for message in recording.read(path)}
    cameras = sorted({camera for key in keys if (camera := camera_of_key(key)) is not None})
    if not cameras:
        raise RecordingError("holds no message of any camera", where=str(path), action="give a site's recording")
    site = next(key for key in keys if camera_of_key(key) is not None).split("/")[2]
    return ReplaySource(site, tuple(cameras), path)


def _of_recording(path: Path) -> Iterator[Said]:
    for message in recording.read(path):
        camera, topic = camera_of_key(message.key), message.key.rpartition("/")[2]
        if camera is not None and topic in PLAYED:
            yield Said(message.t_arrival_ns, camera, topic, message.payload)


def _of_scene(scene: Scene, epoch: int) -> Iterator[Said]:
    """Lenses and positions first, then every frame of every camera by its stamp."""
    observations = {
        camera.id: scene.observations[camera.id] for camera in scene.cameras if camera.id in scene.observations
    }
    if not any(len(seen) for seen in observations.values()):
        raise RecordingError("its tracks hold no row", where=scene.site, action="give a folder with observations")
    first = min(int(seen.t_unix_ns[0]) for seen in observations.values() if len(seen))
    last = max(int(seen.t_unix_ns[-1]) for seen in observations.values() if len(seen))
    for camera in scene.cameras:
        yield Said(first, camera.id, "lens", encode(Lens.of(camera.lens)))
        if camera.position_enu is not None:
            yield Said(first, camera.id, "fix", encode(_fix(camera, scene, first)))
    boxes = [
        _ReplayedBox(camera, observations[camera.id], epoch) for camera in scene.cameras if camera.id in observations
    ]
    frames = [box.frames(first, last) for box in boxes]
    t_ns = np.concatenate([stamps for stamps, _ in frames])
    owner = np.repeat(np.arange(len(boxes)), [len(stamps) for stamps, _ in frames])
    rows = np.concatenate([start for _, start in frames])
    for k in np.argsort(t_ns, kind="stable").tolist():
        box = boxes[owner[k]]
        yield Said(int(t_ns[k]), box.camera.id, "tracks", encode(box.message(int(t_ns[k]), int(rows[k]))))


def _fix(camera: SiteCamera, scene: Scene, t_unix_ns: int) -> Fix:
    assert camera.position_enu is not None
    assert camera.position_covariance is not None
    lat, lon, height = enu_to_geodetic(camera.position_enu[None], scene.origin)[0].tolist()
    east, north, up = np.sqrt(np.diag(camera.position_covariance)).tolist()
    return Fix(
        t_unix_ns=t_unix_ns,
        lat_deg=lat,
        lon_deg=lon,
        height_m=height,
        quality=4,
        sigma_m=(east, north, up),
        frame="as surveyed",
        samples=1,
        of="lens",
    )


class _ReplayedBox:
    """A camera box that says again what its track file holds."""

    def __init__(self, camera: SiteCamera, seen: Observations, epoch: int) -> None:
        self.camera = camera
        self._seen = seen
        self._rays: Array = pixel_to_ray(camera.lens, seen.pixels)
        self._epoch = epoch
        self._seq = 0

    def frames(self, first_ns: int, last_ns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Stamps (F,) of the frames to tell of, in order, and the first row (F,) of each; -1 for one that is empty."""
        stamps, start = np.unique(self._seen.t_unix_ns, return_index=True)
        edges = np.concatenate([[first_ns], stamps, [last_ns]])
        silent = [
            np.arange(before + SILENCE_NS, after, SILENCE_NS)
            for before, after in pairwise(edges.tolist())
            if after - before > SILENCE_NS
        ]
        quiet = np.concatenate([np.zeros(0, np.int64), *silent])
        all_stamps = np.concatenate([stamps, quiet])
        order = np.argsort(all_stamps, kind="stable")
        rows = np.concatenate([start, np.full(len(quiet), -1)])
        return all_stamps[order], rows[order]

    def message(self, t_unix_ns: int, row: int) -> Tracks:
        """The frame whose first row that is; an empty one for -1."""
        detections = []
        while 0 <= row < len(self._seen) and self._seen.t_unix_ns[row] == t_unix_ns:
            if np.isfinite(self._rays[row, 0]):
                detections.append(self._detection(row))
            row += 1
        self._seq += 1
        return Tracks(
            t_unix_ns=t_unix_ns,
            seq=self._seq,
            epoch=self._epoch,
            clock_bound_s=self.camera.clock_bound_s,
            size_px=self.camera.lens.size_px,
            readout_s=self.camera.readout_s or 0.0,
            detections=detections,
        )

    def _detection(self, row: int) -> Detection:
        (u, v), (x, y), sigma = self._seen.pixels[row], self._rays[row], self._seen.sigma_px
        return Detection(
            track=int(self._seen.track[row]),
            u_px=float(u),
            v_px=float(v),
            ray_x=float(x),
            ray_y=float(y),
            width_px=0.0,
            height_px=0.0,
            score=1.0,
            sigma_px=None if sigma is None else float(sigma[row]),
            status="confirmed",
        )
