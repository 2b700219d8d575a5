"""One camera's rows as tracks that are each of one object, and what of its rows is not: the step before any geometry.

The hazard is the quiet repair. What is left out and what is linked anew is counted and told, with camera, track and
how many rows, or nobody will mend the tracker that writes it.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.observations import Observations
from calib.solving.found import Cause, Found
from calib.solving.numbering import Numbering, judged
from calib.solving.series import TrackSeries, split_tracks
from calib.solving.unseen import unseen
from edge.common.arrays import Array
from edge.lens import LensModel, pixel_to_ray

NAMED_TRACKS: Final = 3  # in a sentence
FEWEST_TOLD: Final = 3  # rows left out: fewer change nothing


@dataclass(frozen=True)
class CameraTracks:
    """tracks: longest first. rows: how many lie within the lens model. found: what was wrong with its rows."""

    tracks: list[TrackSeries]
    found: tuple[Found, ...]


def camera_tracks(name: str, seen: Observations, lens: LensModel, t_mid_unix_ns: int) -> CameraTracks:
    """The tracks of a camera, and what was left out or linked anew."""
    t_s = np.asarray((seen.t_unix_ns - t_mid_unix_ns) * 1e-9, float)
    blind = unseen(t_s, seen.pixels, float(lens.intrinsics[0]))
    rays = np.where(blind.rows[:, None], np.nan, pixel_to_ray(lens, seen.pixels))
    numbers = judged(t_s, rays, seen.track)
    found = [*_constant(name, seen, blind.constant), *_held(name, seen, blind.held)]
    if numbers.fault:
        found.append(Found(Cause.TRACKS, (name,), _anew(name, numbers, t_mid_unix_ns)))
    return CameraTracks(split_tracks(t_s, rays, numbers.label), tuple(found))


def _constant(name: str, seen: Observations, rows: NDArray[np.bool_]) -> list[Found]:
    if rows.sum() < FEWEST_TOLD:
        return []
    values, counts = np.unique(seen.pixels[rows], axis=0, return_counts=True)
    most = _pixel(values[int(np.argmax(counts))])
    sentence = (
        f"{rows.sum()} rows of {name} ({_of_tracks(seen.track[rows])}) are no measurement: they have the very same "
        f"pixel, {most}, and nothing moved there or away; they were left out: have unseen frames leave no row"
    )
    return [Found(Cause.TRACKS, (name,), sentence)]


def _held(name: str, seen: Observations, rows: NDArray[np.bool_]) -> list[Found]:
    if rows.sum() < FEWEST_TOLD:
        return []
    sentence = (
        f"{rows.sum()} rows of {name} ({_of_tracks(seen.track[rows])}) are no measurement: they repeat the pixel of "
        "the row before, as where a position is held or a picture is frozen; they were left out"
    )
    return [Found(Cause.TRACKS, (name,), sentence)]


def _anew(name: str, numbers: Numbering, t_mid_unix_ns: int) -> str:
    at = datetime.fromtimestamp(t_mid_unix_ns * 1e-9 + numbers.at_s, UTC)
    often = f"{numbers.times} times, first" if numbers.times > 1 else "once,"
    return (
        f"the track numbers of {name} were not used: {numbers.fault} ({often} at {at:%H:%M:%S} UTC); "
        "its rows were linked anew by their motion: look at its tracker"
    )


def _of_tracks(numbers: NDArray[np.int64]) -> str:
    """Which tracks, the first few of many."""
    own = np.unique(numbers)
    named = ", ".join(str(number) for number in own[:NAMED_TRACKS].tolist())
    more = f" and {len(own) - NAMED_TRACKS} more" if len(own) > NAMED_TRACKS else ""
    return f"track{'s' * (len(own) > 1)} {named}{more}"


def _pixel(value: Array) -> str:
    u, v = value.tolist()
    return f"({u:g}, {v:g})"
