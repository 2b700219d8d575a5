"""The reasons of a refusal, in one place: which cameras are missing, why each of them is, and what to do next.

The hazard is one sentence for all causes. What is told is what was tried and found (unposed.py); a lens file that is
wrong in every camera is tried on all of them together, for then no camera fits the others' points, and nobody alone is
to blame.
"""

from typing import Final

import numpy as np

from calib.adjustment.flight import FlightEstimate
from calib.errors import CalibrationError
from calib.solving.found import Cause
from calib.solving.inputs import Inputs
from calib.solving.readings import other_sizes
from calib.solving.scaffold import GOOD_SHARE, Scaffold, build
from calib.solving.series import TrackSeries
from calib.solving.unposed import Known, Unposed, Why, known_of, why_without_pose

FRAME_NEEDS: Final = 3  # surveyed cameras that have a pose, where none says where up is

Tracks = dict[str, list[TrackSeries]]  # of the cameras with a usable clock, at its pace


def refuse_bent(inputs: Inputs, tracks: Tracks, offsets: dict[str, float], scaffold: Scaffold) -> None:
    """Raises CalibrationError for a scaffold that hardly holds, of cameras whose lens files are all of another size.

    Three cameras can fit one another somehow. But then not well, and others do not fit at all; where there are only
    two that do, nothing says that they do so rightly.
    """
    shares = [pose.share for pose in scaffold.poses.values()]
    doubtful = len(shares) < len(offsets) and (min(shares) < GOOD_SHARE or len(shares) < FRAME_NEEDS)
    if doubtful and (every := _wrong_in_all(inputs, tracks, offsets)):
        raise CalibrationError(every.what, where="lens files", action=every.cure)


def too_few_poses(
    inputs: Inputs, tracks: Tracks, offsets: dict[str, float], scaffold: Scaffold
) -> CalibrationError | None:
    """The refusal of a site of whose surveyed cameras too few have a pose; None if it is not for want of poses.

    tracks: at the pace of the cameras' clocks; offsets: of the clocks, s; of those that have a usable one.
    """
    surveyed = [name for name, site in sorted(inputs.sites.items()) if site.position_enu is not None]
    unposed = [name for name in surveyed if name not in scaffold.poses]
    posed = len(surveyed) - len(unposed)
    if not unposed or posed >= FRAME_NEEDS:
        return None
    known = Known(scaffold.t_s, scaffold.points)
    whys = [_why(name, known, inputs, tracks, offsets) for name in unposed]
    return CalibrationError(
        f"{posed} of {len(surveyed)} surveyed cameras have a pose, three must: " + "; ".join(why.what for why in whys),
        where="georeferencing",
        action="; ".join(why.cure for why in whys),
    )


def why_left_out(
    told: dict[str, str], inputs: Inputs, tracks: Tracks, offsets: dict[str, float], estimate: FlightEstimate
) -> dict[str, str]:
    """Better reasons for cameras that a network is without, from the refined flight. told: what is known so far.

    What reading a camera's rows in another way has shown is the reason; where that shows nothing, what was told is.
    """
    known, better = known_of(estimate), {}
    for name in sorted(set(told) & set(tracks)):
        why = _why(name, known, inputs, tracks, offsets)
        if why.shown or not told[name]:
            better[name] = str(why)
    return better


def _why(name: str, known: Known, inputs: Inputs, tracks: Tracks, offsets: dict[str, float]) -> Why:
    if name not in tracks:
        what = inputs.left_out.get(name, "it saw nothing")
        return Why(Cause.TRACKS, name, f"{name} is left out: {what}", f"mend that of {name}")
    camera = Unposed(inputs.sites[name], inputs.scene.observations[name], tracks[name], offsets[name])
    return why_without_pose(known, camera)


def _wrong_in_all(inputs: Inputs, tracks: Tracks, offsets: dict[str, float]) -> Why | None:
    """The picture size that all lens files are not of: read so, every camera fits one scaffold nearly wholly."""
    aligned = sorted(offsets)
    ways = zip(*(other_sizes(inputs.sites[name].lens) for name in aligned), strict=True)
    for together in ways:
        read = {
            name: reading.tracks(inputs.scene.observations[name], tracks[name])
            for name, reading in zip(aligned, together, strict=True)
        }
        try:
            scaffold = build(read, offsets)
        except CalibrationError:
            continue
        shares = [scaffold.poses[name].share if name in scaffold.poses else 0.0 for name in aligned]
        if np.min(shares) >= GOOD_SHARE:
            what = f"the cameras do not fit one another, but the rows of all fit {together[0].what}"
            return Why(Cause.LENS, "", what, f"for all cameras, {together[0].cure}")
    return None
