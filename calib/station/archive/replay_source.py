"""Track folders and recordings as streams of messages, in the order and with the stamps of the original.

The hazard is a replay that helps: one that waits, sorts or leaves out what a real site would not. A recording is
therefore played byte by byte in the order of arrival; a track folder becomes what its boxes would have sent, silence
included, for a camera that sees nothing says so once a second. `solve` reads the same messages, without the silence.
"""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.geodesy import Origin, enu_to_geodetic
from calib.observations import SiteCamera
from calib.station.archive import recording, trackfolder
from calib.station.archive.trackfolder import TrackFolder, TrackRows
from calib.station.core.playback import Played, Recorded, play
from calib.station.core.surveyed_site import SurveyedSite
from edge.common.arrays import Array
from edge.common.errors import RecordingError
from edge.lens import pixel_to_ray
from edge.messages import MAX_RAY, Detection, Fix, Lens, Tracks, camera_key, camera_of_key, encode

log = logging.getLogger(__name__)

SILENCE_NS: Final = 1_000_000_000  # a camera that sees nothing says so this often
REPEATED_TOPICS: Final = ("lens", "fix")  # topics that late joiners are told too
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
    folder: TrackFolder | None = None

    def messages(self, epoch: int) -> Iterator[Said]:
        """All messages in order. epoch: of made-up ones; recorded ones keep theirs."""
        return _of_recording(self.path) if self.folder is None else _of_folder(self.folder, epoch)


def open_source(path: Path) -> ReplaySource:
    """A track folder or a recording. Raises ConfigError or RecordingError naming what is wrong with it."""
    if path.is_dir():
        folder = trackfolder.read(path)
        return ReplaySource(folder.site.name, tuple(camera.id for camera in folder.cameras), path, folder)
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


def play_back(path: Path, site: SurveyedSite | None = None) -> Played:
    """A track folder or a recording through the station's own intake. site: another survey than a recording's own.

    Raises ConfigError or RecordingError naming what is wrong with it.
    """
    if path.is_dir():
        return _play_folder(trackfolder.read(path))
    return play(recording.read(path), site)


def _play_folder(folder: TrackFolder) -> Played:
    key = cache(partial(camera_key, folder.site.name))
    messages = (
        Recorded(key(said.camera, said.topic), said.t_ns, said.payload)
        for said in _of_folder(folder, epoch=1, silence=False)
        if said.topic != "fix"  # the survey says it, with more digits
    )
    # Its stamps are all there is: nobody knows when its rows came, and its cameras may be hours apart.
    played = play(messages, folder.site, arrivals_are_real=False)
    levels = {camera.id: (camera.up_cam, camera.up_sigma_deg) for camera in folder.cameras}
    cameras = tuple(
        replace(camera, up_cam=levels[camera.id][0], up_sigma_deg=levels[camera.id][1])
        for camera in played.scene.cameras
    )
    return replace(played, scene=replace(played.scene, cameras=cameras))


def _of_folder(folder: TrackFolder, epoch: int, *, silence: bool = True) -> Iterator[Said]:
    """Lenses and positions first, then every frame of every camera by its stamp."""
    rows = {camera.id: folder.rows[camera.id] for camera in folder.cameras if camera.id in folder.rows}
    if not any(len(own.t_unix_ns) for own in rows.values()):
        raise RecordingError("its tracks hold no row", where=folder.site.name, action="give a folder with observations")
    first = min(int(own.t_unix_ns[0]) for own in rows.values() if len(own.t_unix_ns))
    last = max(int(own.t_unix_ns[-1]) for own in rows.values() if len(own.t_unix_ns))
    for camera in folder.cameras:
        yield Said(first, camera.id, "lens", encode(Lens.of(camera.lens)))
        if camera.position_enu is not None:
            yield Said(first, camera.id, "fix", encode(_fix(camera, folder.site.origin, first)))
    boxes = [_ReplayedBox(camera, rows[camera.id], epoch) for camera in folder.cameras if camera.id in rows]
    frames = [box.frames(first, last, silence=silence) for box in boxes]
    t_ns = np.concatenate([stamps for stamps, _ in frames])
    owner = np.repeat(np.arange(len(boxes)), [len(stamps) for stamps, _ in frames])
    starts = np.concatenate([start for _, start in frames])
    order = np.argsort(t_ns, kind="stable")
    frame = zip(t_ns[order].tolist(), owner[order].tolist(), starts[order].tolist(), strict=True)
    for t_unix_ns, number, start in frame:
        box = boxes[number]
        yield Said(t_unix_ns, box.camera.id, "tracks", encode(box.message(t_unix_ns, start)))


def _fix(camera: SiteCamera, origin: Origin | None, t_unix_ns: int) -> Fix:
    assert origin is not None
    assert camera.position_enu is not None
    assert camera.position_covariance is not None
    lat, lon, height = enu_to_geodetic(camera.position_enu[None], origin)[0].tolist()
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


def _detections(rows: TrackRows, rays: Array) -> list[Detection | None]:
    """Each row as its box would report it, None where there is no ray. rays: (N, 2).

    A list, for numbers taken from an array one by one cost ten times as much, and a flight has a hundred thousand.
    """
    return [
        Detection(
            track=track,
            u_px=u,
            v_px=v,
            ray_x=x,
            ray_y=y,
            width_px=0.0,
            height_px=0.0,
            score=1.0,
            status="confirmed" if seen else "interpolated",
        )
        if abs(x) <= MAX_RAY and abs(y) <= MAX_RAY  # nan is not
        else None
        for track, (u, v), (x, y), seen in zip(
            rows.track.tolist(), rows.pixels.tolist(), rays.tolist(), rows.seen.tolist(), strict=True
        )
    ]


class _ReplayedBox:
    """A camera box that says again what its track file holds."""

    def __init__(self, camera: SiteCamera, rows: TrackRows, epoch: int) -> None:
        self.camera = camera
        self._stamps: list[int] = rows.t_unix_ns.tolist()
        self._detections = _detections(rows, pixel_to_ray(camera.lens, rows.pixels))
        without = self._detections.count(None)
        if without:
            log.warning(
                "camera %s: its lens model has no ray for %d of %d rows, which are left out; check its lens file",
                camera.id, without, len(self._detections),
            )  # fmt: skip
        self._epoch = epoch
        self._seq = 0

    def frames(self, first_ns: int, last_ns: int, *, silence: bool) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Stamps (F,) of the frames to tell of, in order, and the first row (F,) of each; -1 for one that is empty."""
        stamps, start = np.unique(np.array(self._stamps, np.int64), return_index=True)
        if not silence:
            return stamps, start
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
        detections: list[Detection] = []
        while 0 <= row < len(self._stamps) and self._stamps[row] == t_unix_ns:
            detection = self._detections[row]
            if detection is not None:
                detections.append(detection)
            row += 1
        self._seq += 1
        return Tracks(
            t_unix_ns=t_unix_ns,
            seq=self._seq,
            epoch=self._epoch,
            clock_bound_s=self.camera.clock_bound_s,
            size_px=self.camera.lens.size_px,
            readout_s=self.camera.readout_s,
            detections=detections,
        )
