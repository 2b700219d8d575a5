"""Whether the cameras see the object from different places at all, or the same rays but for a turn of the head.

The hazard is the object at infinity. Three cameras on a bar and a drone two kilometres away see the same path, turned;
what little they differ by is what a lens file a per cent off does, and an adjustment that has to put the object
somewhere puts it fifteen metres in front of the bar, with residuals as small as any. So the hypothesis that there is
nothing but a turn is tried first: if it explains all pairs of cameras, no position can be had from them.
"""

from itertools import combinations
from typing import Final

import numpy as np

from calib.errors import UndeterminedError
from calib.geometry.rays import directions_cam
from calib.geometry.rotation import fit_rotation
from calib.solving.clock_consensus import Clock
from calib.solving.scaffold import NOISE_SIGMAS
from calib.solving.series import TrackSeries, common, noise_ray
from edge.common.arrays import Array

COMPARED: Final = 200  # common rows of a pair
FEWEST_COMPARED: Final = 20
LENS_FILE_OFF: Final = 0.01  # of a ray's distance from the middle of the path: what an ordinary lens file may do
NEARLY_ALL: Final = 90.0  # per cent of the rows that a turn has to explain


def refuse_parallel_rays(tracks: dict[str, list[TrackSeries]], clocks: dict[str, Clock]) -> None:
    """Raises UndeterminedError if every two cameras that share the object see it under the same rays but for a turn.

    tracks: by camera, longest first; clocks: of the cameras to look at.
    """
    pairs = [pair for pair in combinations(sorted(clocks), 2) if all(tracks.get(name) for name in pair)]
    found = [one for a, b in pairs if (one := _turn((tracks[a][0], clocks[a]), (tracks[b][0], clocks[b])))]
    if not found or any(off > allowed for off, allowed in found):
        return
    raise UndeterminedError(
        "all cameras see the object under the same rays but for a turn, to "
        f"{1e3 * max(off for off, _ in found):.1f} mrad where their lens files are good to "
        f"{1e3 * max(allowed for _, allowed in found):.1f}: nothing tells how far away it is",
        where=", ".join(sorted(clocks)),
        action="stand the cameras farther apart, or fly nearer to them and farther about",
    )


def _turn(one: tuple[TrackSeries, Clock], two: tuple[TrackSeries, Clock]) -> tuple[float, float] | None:
    """How far (ray units) a pair differs by more than a turn, and how far lens files and noise allow."""
    tracks = [[track.stretched(clock.rate)] for track, clock in (one, two)]
    seen = common(tracks[0], tracks[1], one[1].offset_s, two[1].offset_s, COMPARED)
    if len(seen.t_s) < FEWEST_COMPARED:
        return None
    first, second = directions_cam(seen.rays1), directions_cam(seen.rays2)
    turn = fit_rotation(second, first[None], np.ones(len(first)))[0]
    off = float(np.percentile(np.linalg.norm(second - first @ turn.T, axis=1), NEARLY_ALL))
    reach = max(float(np.percentile(_reach(rays), NEARLY_ALL)) for rays in (seen.rays1, seen.rays2))
    noise = max(noise_ray(own) for own in tracks)
    return off, float(np.hypot(LENS_FILE_OFF * reach, NOISE_SIGMAS * noise))


def _reach(rays: Array) -> Array:
    """(N,) distance of each ray from the middle of its path."""
    away: Array = np.linalg.norm(rays - np.median(rays, axis=0), axis=1)
    return away
