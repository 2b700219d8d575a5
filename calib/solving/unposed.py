"""Why a camera has no pose: what people bring is tried on it, and the cause that makes its rows fit is the one named.

The hazard is the reason of the last step. "Two cameras have a surveyed position, three must" is true of a wrong lens
file, of mirrored pictures and of a camera that looks elsewhere, and sends somebody out to survey tripods that are
surveyed. So the rows of a camera that does not fit the others' points are read in other ways (readings.py); a cause is
named only if it explains nearly all of them, and what was tried in vain is said.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.adjustment.flight import FlightEstimate
from calib.geometry.spline import evaluate
from calib.observations import Observations, SiteCamera
from calib.solving.found import Cause
from calib.solving.readings import Reading, readings
from calib.solving.scaffold import GOOD_SHARE, Known, matched, resect_camera
from calib.solving.series import TrackSeries

FEWEST_SHARED: Final = 20  # of the others' points: fewer carry no pose, and no doubt of one
KNOWN_ROWS: Final = 400  # of a refined flight, evenly spread, that a camera is tried on


@dataclass(frozen=True)
class Unposed:
    """A camera without a pose: what it saw, its tracks at the pace of its clock, and what is to be added to them."""

    site: SiteCamera
    observations: Observations
    tracks: list[TrackSeries]
    offset_s: float


@dataclass(frozen=True)
class Why:
    """The reason: what is wrong with which camera, and what to do. VIEWS is no fault. shown: found by trying."""

    cause: Cause
    camera: str
    what: str
    cure: str
    shown: bool = True

    def __str__(self) -> str:
        return f"{self.what}: {self.cure}"


def known_of(estimate: FlightEstimate) -> Known:
    """A refined flight at instants spread over all of it."""
    flight = estimate.flight
    step_s = float(flight.spans.sum()) * flight.spacing_s / KNOWN_ROWS
    own = [np.arange(0.0, float(spans) * flight.spacing_s, step_s) for spans in flight.spans]
    stretch = np.repeat(np.arange(len(own)), [len(times) for times in own])
    t_s = flight.start_s[stretch] + np.concatenate(own)
    return Known(t_s, evaluate(flight.locate(t_s, stretch), estimate.control), flight.target[stretch])


def why_without_pose(known: Known, camera: Unposed) -> Why:
    """The cause that was found by trying, or what was tried in vain."""
    name = camera.site.id
    if len(matched(known, camera.tracks, camera.offset_s)[0]) < FEWEST_SHARED:
        what = f"{name} hardly ever saw an object while two others did"
        return Why(Cause.VIEWS, name, what, f"turn {name} to where they look, or fly where all of them see it")
    best = _best_reading(known, camera)
    if best is not None:
        return Why(
            best.cause, name, f"{name} has no pose as it is, but its rows fit {best.what}", f"for {name}, {best.cure}"
        )
    share = explained_share(known, camera.tracks, camera.offset_s)
    what = f"no pose explains more than {100 * share:.0f} % of the rows of {name}"
    tried = "nor with another focal length or picture size, nor mirrored"
    return Why(Cause.TRACKS, name, f"{what}, {tried}", f"check what {name} detects, and its clock", shown=False)


def _best_reading(known: Known, camera: Unposed) -> Reading | None:
    """The way to read its rows that explains most of them, if that is nearly all."""
    shares = []
    for reading in readings(camera.site.lens):
        tracks = reading.tracks(camera.observations, camera.tracks)
        shares.append((explained_share(known, tracks, camera.offset_s), reading))
    share, best = max(shares, key=lambda each: each[0])
    return best if share >= GOOD_SHARE else None


def explained_share(known: Known, tracks: list[TrackSeries], offset_s: float) -> float:
    """Of the instants at which a track runs, for how many one pose explains some point of then."""
    pose = resect_camera(known, tracks, offset_s, FEWEST_SHARED)
    return pose.share if pose else 0.0
