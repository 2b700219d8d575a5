"""site.toml: the cameras of a site and what is known of them beforehand.

The contract of deploy/CONTRACTS.md, strictly read: a misspelt key would silently drop a position. What other programs
may leave out has a default; what is unknown stays None, because "nothing is known" and "zero" are different statements.
"""

from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from calib.geodesy import Origin, geodetic_to_enu, mean_position
from calib.observations import SiteCamera
from calib.station.config import UNSTATED_SIGMA_M, Geodetic, Sigmas
from calib.station.core import site_extent
from calib.station.core.coordinates import Written
from edge.common import settings
from edge.common.errors import ConfigError, LensError
from edge.lens import LensModel, LensName, check_lens_name
from edge.messages import Name, SizePx


class _Site(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: Name
    origin: Geodetic | None = None


class _Camera(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One [[camera]]. The last five keys are ours: a program that does not know them loses nothing it had."""

    id: Name
    size_px: SizePx
    lens: LensName
    intrinsics: tuple[float, float, float, float]
    distortion: list[float]
    position: Geodetic | None = None
    position_sigma: Sigmas = UNSTATED_SIGMA_M
    focal_sigma_px: Annotated[float, Meta(gt=0)] | None = None
    clock_bound_s: Annotated[float, Meta(ge=0)] | None = None
    readout_s: Annotated[float, Meta(ge=0, le=1)] | None = None
    up_cam: tuple[float, float, float] | None = None
    up_sigma_deg: Annotated[float, Meta(gt=0, le=45)] | None = None

    def __post_init__(self) -> None:
        check_lens_name("lens", self.lens)


class SiteFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of a site.toml."""

    site: _Site
    camera: Annotated[list[_Camera], Meta(min_length=1)]


def read(path: Path) -> SiteFile:
    """A site file as it stands. Raises ConfigError naming file, key and what is allowed there."""
    file = settings.load(path, SiteFile)
    names = [camera.id for camera in file.camera]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(f"camera {twice[0]} is named twice", where=str(path), action="give each camera its own id")
    _refuse_impossible(file, path)
    return file


def _refuse_impossible(file: SiteFile, path: Path) -> None:
    """Raises ConfigError for positions that no site has."""
    places = {camera.id: camera.position for camera in file.camera if camera.position is not None}
    for name, why in site_extent.too_far(places).items():
        raise ConfigError(why, where=f"{path}: camera {name}", action=site_extent.CORRECT_IT)
    if site_extent.all_in_one_place(places):
        raise ConfigError(
            "all cameras have the same position", where=str(path), action="give each the position of its own lens"
        )
    if file.site.origin is not None and site_extent.exchanged(places, file.site.origin):
        what = "latitude and longitude are exchanged: that way all cameras are near the origin"
        raise ConfigError(what, where=str(path), action=site_extent.CORRECT_IT)


def load(path: Path) -> tuple[str, Origin, tuple[SiteCamera, ...]]:
    """Name, origin and cameras of a site file. Raises ConfigError as `read` does."""
    file = read(path)
    origin = file.site.origin or _mean_position(file.camera)
    written = written_in(file)
    return file.site.name, origin, tuple(_site_camera(camera, origin, written, path) for camera in file.camera)


def written_in(file: SiteFile) -> Written:
    """How finely its positions are written."""
    return Written.of((one.position, one.position_sigma) for one in file.camera if one.position is not None)


def _mean_position(cameras: list[_Camera]) -> Origin:
    """The mean of the surveyed cameras; without any, a place on the equator that nothing will be drawn at."""
    positions = [camera.position for camera in cameras if camera.position]
    if not positions:
        return (0.0, 0.0, 0.0)
    return mean_position(np.array(positions))


def _site_camera(camera: _Camera, origin: Origin, written: Written, path: Path) -> SiteCamera:
    try:
        lens = LensModel(
            camera.lens,
            camera.intrinsics,
            tuple(camera.distortion),
            camera.size_px,
            focal_sigma_px=camera.focal_sigma_px,
        )
    except LensError as error:
        raise ConfigError(error.what, where=f"{path}: camera {camera.id}", action=error.action) from error
    up = np.array(camera.up_cam, float) if camera.up_cam else None
    sigma_m = written.sigma_m(camera.position, camera.position_sigma) if camera.position else None
    return SiteCamera(
        id=camera.id,
        lens=lens,
        position_enu=geodetic_to_enu(np.array(camera.position), origin)[0] if camera.position else None,
        position_covariance=None if sigma_m is None else np.diag(np.square(sigma_m)),
        clock_bound_s=camera.clock_bound_s,
        readout_s=camera.readout_s,
        up_cam=None if up is None else up / np.linalg.norm(up),
        up_sigma_deg=camera.up_sigma_deg,
    )
