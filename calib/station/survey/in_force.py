"""Which positions are in force: the configuration's own, and else those of its survey file.

The hazard is a file that is read leniently: a misspelt `positon` in it would take a camera's place away without a word.
So there is one rule for where the survey is, and each of the two kinds of file it may be (what `base-station survey`
writes, or a track folder's site.toml) has its one strict reader.
"""

from pathlib import Path
from typing import Final

from calib.reference_frame import ReferenceFrame
from calib.station.archive import sitefile
from calib.station.config import UNSTATED_SIGMA_M, BaseConfig, CameraSection, Geodetic, Sigmas
from calib.station.survey.derive import frame_of
from calib.station.survey.store import load_survey
from edge.common.errors import ConfigError
from edge.common.toml_text import read_toml

SURVEY_FILE: Final = "survey.toml"  # beside the configuration: read where [site] survey names no other
LENS_KEYS: Final = frozenset({"size_px", "lens", "intrinsics", "distortion"})  # of a site.toml's [[camera]]


def survey_file(config: BaseConfig, folder: Path) -> Path | None:
    """The survey that the station reads, or None if there is none. folder: the configuration's."""
    if config.site.survey is not None:
        return folder / config.site.survey
    default = folder / SURVEY_FILE
    return default if default.exists() else None


def with_survey(config: BaseConfig, folder: Path) -> dict[str, CameraSection]:
    """The configured cameras by id, positions filled in from the survey where the configuration gives none.

    folder: what a relative path is relative to. Raises ConfigError if the survey cannot be read as one.
    """
    path = survey_file(config, folder)
    surveyed = {} if path is None else surveyed_in(path)
    return {
        camera.id: surveyed[camera.id] if camera.position is None and camera.id in surveyed else camera
        for camera in config.camera
    }


def frames_in_force(config: BaseConfig, folder: Path) -> dict[str, ReferenceFrame]:
    """The reference frame of each camera that with_survey finds a position of. Raises ConfigError as that does."""
    path = survey_file(config, folder)
    surveyed = {} if path is None else surveyed_in(path)
    of_survey = frame_of(load_survey(path)) if path is not None and is_survey(path) else ReferenceFrame()
    given = {camera.id: camera.position is not None for camera in config.camera}
    return {
        camera: ReferenceFrame(config.site.frame) if in_config else of_survey
        for camera, in_config in given.items()
        if in_config or camera in surveyed
    }


def twice_given(config: BaseConfig, folder: Path) -> list[str]:
    """Cameras whose position stands both in the configuration, where it is in force, and in the survey.

    Raises ConfigError as with_survey.
    """
    path = survey_file(config, folder)
    surveyed = {} if path is None else surveyed_in(path)
    return [camera.id for camera in config.camera if camera.position is not None and camera.id in surveyed]


def surveyed_in(path: Path) -> dict[str, CameraSection]:
    """The cameras in a survey or site.toml that have a position. Raises ConfigError naming file and key."""
    if _is_site_file(path):
        rows = sitefile.read(path).camera
        return {row.id: _section(row.id, row.position, row.position_sigma) for row in rows if row.position is not None}
    tables = load_survey(path).camera
    return {
        table.id: _section(table.id, table.position, table.position_sigma)
        for table in tables
        if table.position is not None
    }


def is_survey(path: Path) -> bool:
    """Whether it is a file that `base-station survey` writes. Raises ConfigError if it cannot be read."""
    return not _is_site_file(path)


def _is_site_file(path: Path) -> bool:
    """Whether it is a track folder's site.toml: that says of each camera what its lens is, a survey never does."""
    try:
        tree = read_toml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(
            f"the survey cannot be read ({error.strerror})",
            where=str(path),
            action="make it with `base-station survey`, or correct [site] survey",
        ) from error
    except ValueError:
        return False  # the survey's reader says what is wrong with it
    rows = tree.get("camera", [])
    return isinstance(rows, list) and any(isinstance(row, dict) and row.keys() & LENS_KEYS for row in rows)


def _section(camera: str, position: Geodetic, sigma_m: Sigmas | None) -> CameraSection:
    return CameraSection(id=camera, position=position, position_sigma=sigma_m or UNSTATED_SIGMA_M)
