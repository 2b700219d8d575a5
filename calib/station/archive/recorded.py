"""A recording as a scene: what the boxes said, as the calibration wants it.

The hazard is to trust a recording more than the live network: it is decoded by the same rules, rows are counted once
even where a backlog repeats them, and a box that started again begins a new epoch of sequence numbers.
"""

import logging
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.geodesy import Origin, geodetic_to_enu
from calib.observations import Observations, Scene, SiteCamera
from calib.station.archive import recording
from edge.common.errors import ConfigError, LensError, MessageError
from edge.lens import LensModel
from edge.messages import Fix, Lens, Tracks, camera_of_key, decode

log = logging.getLogger(__name__)

Row = tuple[int, float, float, int, float]  # t_unix_ns, u_px, v_px, track, sigma_px or nan


@dataclass
class _Box:
    """What one camera's messages say."""

    rows: list[Row] = field(default_factory=list)
    seen: set[tuple[int, int]] = field(default_factory=set)  # epoch, sequence number
    lens: Lens | None = None
    fix: Fix | None = None
    clock_bound_s: float | None = None
    readout_s: float | None = None

    def take(self, topic: str, payload: bytes, key: str) -> None:
        """One message of this camera."""
        if topic == "lens":
            self.lens = decode(payload, Lens, where=key)
        elif topic == "fix":
            self.fix = decode(payload, Fix, where=key)
        elif topic in ("tracks", "backlog"):
            self._take_tracks(decode(payload, Tracks, where=key))

    def _take_tracks(self, message: Tracks) -> None:
        if (message.epoch, message.seq) in self.seen:
            return
        self.seen.add((message.epoch, message.seq))
        self.clock_bound_s, self.readout_s = message.clock_bound_s, message.readout_s
        for d in message.detections:
            if d.status == "confirmed":
                sigma = d.sigma_px if d.sigma_px is not None else np.nan
                self.rows.append((message.t_unix_ns, d.u_px, d.v_px, d.track, sigma))


def load(path: Path) -> Scene:
    """A recording (.mcap) as a scene; cameras without a lens are left out and named.

    Raises RecordingError if it is no recording, ConfigError if it holds no camera that can be used.
    """
    boxes: dict[str, _Box] = {}
    site = path.stem
    refused = 0
    for message in recording.read(path):
        camera = camera_of_key(message.key)
        if camera is None:
            continue
        site = message.key.split("/")[2]
        try:
            boxes.setdefault(camera, _Box()).take(message.key.rpartition("/")[2], message.payload, message.key)
        except MessageError as error:
            refused += 1
            log.debug("%s", error)
    if refused:
        log.warning("%s: %d messages are not what their keys claim; left out", path, refused)
    usable = {name: box for name, box in sorted(boxes.items()) if box.lens is not None}
    for name in sorted(set(boxes) - set(usable)):
        log.warning("%s: camera %s never said what lens it has; left out", path, name)
    if not usable:
        raise ConfigError("no camera with a lens in it", where=str(path), action="record a site with running boxes")
    origin = _origin(usable)
    cameras = tuple(_site_camera(name, box, origin, path) for name, box in usable.items())
    return Scene(site, origin, cameras, {name: _observations(box) for name, box in usable.items()})


def _origin(boxes: dict[str, _Box]) -> Origin:
    fixes = [(box.fix.lat_deg, box.fix.lon_deg, box.fix.height_m) for box in boxes.values() if box.fix]
    lat, lon, height = np.mean(fixes, axis=0).tolist() if fixes else (0.0, 0.0, 0.0)
    return (lat, lon, height)


def _site_camera(name: str, box: _Box, origin: Origin, path: Path) -> SiteCamera:
    assert box.lens is not None
    try:
        lens = LensModel.of(box.lens)
    except LensError as error:
        raise ConfigError(error.what, where=f"{path}: camera {name}", action=error.action) from error
    position = covariance = None
    if box.fix is not None:
        position = geodetic_to_enu(np.array([box.fix.lat_deg, box.fix.lon_deg, box.fix.height_m]), origin)[0]
        covariance = np.diag(np.square(np.maximum(box.fix.sigma_m, 1e-3)))
    return SiteCamera(name, lens, position, covariance, box.clock_bound_s, box.readout_s)


def _observations(box: _Box) -> Observations:
    rows = sorted(box.rows)
    t = np.array([row[0] for row in rows], np.int64)
    pixels = np.array([row[1:3] for row in rows], float).reshape(-1, 2)
    track = np.array([row[3] for row in rows], np.int64)
    sigma = np.array([row[4] for row in rows], float)
    return Observations(t, pixels, track, sigma if len(sigma) and np.isfinite(sigma).all() else None)
