"""Where the cameras stand, from whichever source says so: the configuration, a surveyed site file, or the boxes.

The hazard is a frame that moves. All estimation is about one origin; it is fixed by the first complete set of
positions and kept, because a better fix of one tripod must not shift every target by a metre.
"""

import tomllib
from pathlib import Path

import numpy as np

from calib.geodesy import Origin, geodetic_to_enu
from calib.observations import SiteCamera
from calib.station.config import MIN_CAMERAS, BaseConfig, CameraSection
from calib.station.core.intake import CameraIntake
from edge.common import settings
from edge.common.arrays import Array
from edge.common.errors import ConfigError


def with_survey(config: BaseConfig, folder: Path) -> dict[str, CameraSection]:
    """The configured cameras by id, positions filled in from the survey's site file where there is one.

    folder: what a relative path is relative to. Raises ConfigError if the file is none.
    """
    surveyed = _read(folder / config.site.survey) if config.site.survey else {}
    cameras = {camera.id: camera for camera in config.camera}
    for camera_id, camera in cameras.items():
        if camera.position is None and camera_id in surveyed:
            cameras[camera_id] = surveyed[camera_id]
    return cameras


def _read(path: Path) -> dict[str, CameraSection]:
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
        rows = [row for row in tree.get("camera", []) if "position" in row]
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(
            f"no site file ({error})", where=str(path), action="run base-station survey, or correct [site] survey"
        ) from error
    known = ("id", "position", "position_sigma")
    cameras = [
        settings.build({key: row[key] for key in known if key in row}, CameraSection, where=str(path)) for row in rows
    ]
    return {camera.id: camera for camera in cameras}


class Positions:
    """Camera positions in the site's frame. origin: None until enough cameras have a position."""

    def __init__(self, cameras: dict[str, CameraSection], origin: Origin | None) -> None:
        self._cameras = cameras
        self.origin = origin

    def update(self, boxes: dict[str, CameraIntake]) -> None:
        """Choose the origin, once enough positions are known."""
        if self.origin is None:
            known = [place for camera in self._cameras if (place := self._geodetic(camera, boxes)) is not None]
            if len(known) >= min(MIN_CAMERAS, len(self._cameras)):
                latitude, longitude, height = np.mean(known, axis=0).tolist()
                self.origin = (latitude, longitude, height)

    def _geodetic(self, camera: str, boxes: dict[str, CameraIntake]) -> tuple[float, float, float] | None:
        fix, section = boxes[camera].fix, self._cameras[camera]
        if section.position is not None:
            return section.position
        return None if fix is None else (fix.lat_deg, fix.lon_deg, fix.height_m)

    def of(self, camera: str, box: CameraIntake) -> tuple[Array, Array] | None:
        """(3,) ENU metres and (3, 3) covariance of a camera's optical centre, or None if it is not known."""
        place = self._geodetic(camera, {camera: box})
        if place is None or self.origin is None:
            return None
        section = self._cameras[camera]
        enu = geodetic_to_enu(np.array([place]), self.origin)[0]
        if section.position is not None:
            return enu, np.diag(np.square(section.position_sigma))
        assert box.fix is not None
        return enu + section.antenna_to_camera_m, np.diag(np.square(np.maximum(box.fix.sigma_m, 0.005)))

    def site_camera(self, camera: str, box: CameraIntake) -> SiteCamera | None:
        """What is known of a camera before calibrating, or None without a lens."""
        if box.lens is None:
            return None
        place = self.of(camera, box)
        return SiteCamera(
            camera,
            box.lens,
            position_enu=None if place is None else place[0],
            position_covariance=None if place is None else place[1],
            clock_bound_s=box.clock_bound_s,
            readout_s=box.readout_s or None,
        )
