"""What one solve works on: the scene's cameras and tracks, sorted out before any geometry.

The hazard is the track that says nothing and fits everything: a lamp, a dead pixel. It is left out here, with a reason.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from calib.errors import CalibrationError
from calib.observations import Scene, SiteCamera
from calib.solving.camera_tracks import camera_tracks
from calib.solving.copies import refuse_copies
from calib.solving.found import Found
from calib.solving.series import TrackSeries, noise_ray
from edge.lens import LensModel

STANDING_RAY: Final = 2e-3  # ray units over a whole track: 0.2 m at 100 m, what a lamp does in the wind
STANDING_SIGMAS: Final = 10.0  # times the track's own noise
FEWEST_CAMERA_ROWS: Final = 30  # of a camera: below it there is nothing to align


@dataclass(frozen=True)
class Inputs:
    """sites, tracks: by camera; only cameras with a track are in `tracks`, the others in left_out with the reason.
    found: what was wrong with their rows.

    t_mid_unix_ns: middle of the flight, the epoch of all times in seconds and of the clock rates.
    """

    scene: Scene
    t_mid_unix_ns: int
    sites: dict[str, SiteCamera]
    tracks: dict[str, list[TrackSeries]]
    left_out: dict[str, str]
    found: tuple[Found, ...] = ()


def prepare(scene: Scene, *, local: bool = False, lenses: dict[str, LensModel] | None = None) -> Inputs:
    """Sort a scene out. local: surveyed positions are not used. lenses: better than the site's, to read tracks with.

    Raises CalibrationError if fewer than two cameras saw anything, or two saw the very same.
    """
    cameras = [replace(c, position_enu=None, position_covariance=None) if local else c for c in scene.cameras]
    sites = {camera.id: camera for camera in cameras}
    rows = scene.observations
    seen = {name: rows[name] for name in sorted(sites) if name in rows and len(rows[name]) >= FEWEST_CAMERA_ROWS}
    left_out = {
        name: f"it saw the object in fewer than {FEWEST_CAMERA_ROWS} frames" for name in sites if name not in seen
    }
    if len(seen) < 2:
        raise CalibrationError(
            f"{len(seen)} cameras saw anything, two must", where=scene.site, action="check that the detectors run"
        )
    refuse_copies(seen, scene.site)
    starts, ends = zip(*((int(own.t_unix_ns[0]), int(own.t_unix_ns[-1])) for own in seen.values()), strict=True)
    t_mid = (int(np.median(starts)) + int(np.median(ends))) // 2
    read = {
        name: camera_tracks(name, own, (lenses or {}).get(name, sites[name].lens), t_mid) for name, own in seen.items()
    }
    split = {name: own.tracks for name, own in read.items()}
    found = tuple(each for own in read.values() for each in own.found)
    for name in [name for name, own in split.items() if not own]:
        left_out[name] = "no track of ten rows lies within its lens model: check its lens file and resolution"
    moving = {name: [track for track in own if _moves(track)] for name, own in split.items() if own}
    for name in [name for name, own in moving.items() if not own]:
        left_out[name] = "what it follows does not move: look for a lamp, a dead pixel or a stopped detector"
    return Inputs(scene, t_mid, sites, {name: own for name, own in moving.items() if own}, left_out, found)


def _moves(track: TrackSeries) -> bool:
    """Whether a track goes anywhere: one that stands still fits every geometry and every clock."""
    low, high = np.percentile(track.rays, [5, 95], axis=0)
    return bool(np.hypot(*(high - low)) > max(STANDING_RAY, STANDING_SIGMAS * noise_ray([track])))
