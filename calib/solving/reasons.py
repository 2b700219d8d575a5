"""The reasons of a refusal, in one place: which cameras are missing, why each of them is, and what to do next.

The hazard is one sentence for all causes. What is told is what was tried and found (unposed.py); a lens file that is
wrong in every camera is tried on all of them together, for then no camera fits the others' points, and nobody alone is
to blame.
"""

import sys
from itertools import combinations
from typing import Final

import numpy as np

from calib.adjustment.flight import FlightEstimate
from calib.errors import CalibrationError, ContradictionError
from calib.geometry.similarity import HOLD_A_FRAME
from calib.solving.found import Cause
from calib.solving.inputs import Inputs
from calib.solving.readings import other_sizes
from calib.solving.scaffold import GOOD_SHARE, Known, Scaffold, build
from calib.solving.series import TrackSeries, common
from calib.solving.unposed import Unposed, Why, explained_share, known_of, why_without_pose

FEWEST_CAMERAS: Final = 2  # of anything that is seen together
WHOLE_SHARE: Final = 0.97  # of its rows, that a right lens file explains; with a wrong one two cameras reach 0.96
CHANCE_SHARE: Final = 0.1  # that rows of something else explain; those of a wrong lens file explain twice as many
DO_THAT: Final = "do that, and solve again"
Tracks = dict[str, list[TrackSeries]]  # of the cameras with a usable clock, at its pace


def refuse_alone(inputs: Inputs, tracks: Tracks) -> None:
    """Raises CalibrationError for a site of which fewer than two cameras can take part, with the reason of each."""
    if len(tracks) < FEWEST_CAMERAS:
        whose = {
            why: [name for name, own in sorted(inputs.left_out.items()) if own == why]
            for why in inputs.left_out.values()
        }
        whys = "; ".join(f"{', '.join(names)}: {why}" for why, names in sorted(whose.items()))
        raise CalibrationError(
            f"{len(tracks)} of {len(inputs.sites)} cameras can take part, two must: {whys}",
            where="tracks",
            action=DO_THAT,
        )


def refuse_bent(inputs: Inputs, tracks: Tracks, offsets: dict[str, float], scaffold: Scaffold) -> None:
    """Raises ContradictionError for a scaffold that hardly holds, of cameras whose lens files are all of another size.

    Three cameras can fit one another somehow. But then not well, and others do not fit at all; where there are only
    two that do, nothing says that they do so rightly.
    """
    shares = [pose.share for pose in scaffold.poses.values()]
    doubtful = len(shares) < len(offsets) and (min(shares) < GOOD_SHARE or len(shares) < HOLD_A_FRAME)
    if doubtful and not _apart(tracks, offsets, scaffold) and (every := _wrong_in_all(inputs, tracks, offsets)):
        raise ContradictionError(every.what, where="lens files", action=every.cure)


def too_few_poses(
    inputs: Inputs, tracks: Tracks, offsets: dict[str, float], scaffold: Scaffold
) -> CalibrationError | None:
    """The refusal of a site of whose surveyed cameras too few have a pose; None if it is not for want of poses.

    tracks: at the pace of the cameras' clocks; offsets: of the clocks, s; of those that have a usable one.
    """
    surveyed = [name for name, site in sorted(inputs.sites.items()) if site.position_enu is not None]
    unposed = [name for name in surveyed if name not in scaffold.poses]
    posed = len(surveyed) - len(unposed)
    if not unposed or posed >= HOLD_A_FRAME:
        return None
    apart = _apart(tracks, offsets, scaffold)
    if apart is not None:
        return CalibrationError(apart.what, where="georeferencing", action=apart.cure)
    known = scaffold.known
    whys = [_why(name, known, inputs, tracks, offsets) for name in unposed]
    if len(whys) == 1 and len(surveyed) == HOLD_A_FRAME and whys[0].cause is Cause.TRACKS and not whys[0].shown:
        return _one_of_three(surveyed, whys[0])
    return CalibrationError(
        f"{posed} of {len(surveyed)} surveyed cameras have a pose, three must: " + "; ".join(why.what for why in whys),
        where="georeferencing",
        action="; ".join(why.cure for why in whys if why.cure) or DO_THAT,
    )


def _one_of_three(surveyed: list[str], why: Why) -> CalibrationError:
    """Two cameras nearly always fit somehow: that the third fits neither of them may be the fault of any."""
    whose = f"{', '.join(surveyed[:-1])} and {surveyed[-1]}"
    return CalibrationError(
        f"2 of 3 surveyed cameras have a pose, three must: one of {whose} does not fit the other two, and which cannot "
        f"be told; if those are right, {why.what}",
        where="georeferencing",
        action=f"{why.cure}; then the same of the others, or add a fourth camera",
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
        return Why(Cause.TRACKS, name, f"{name} is left out: {inputs.left_out.get(name, 'it saw nothing')}", "")
    camera = Unposed(inputs.sites[name], inputs.scene.observations[name], tracks[name], offsets[name])
    return why_without_pose(known, camera)


def _apart(tracks: Tracks, offsets: dict[str, float], scaffold: Scaffold) -> Why | None:
    """What lacks between the scaffold and the other cameras, if those fit one another and so are well themselves.

    Two cameras nearly always fit somehow: so both parts must fit wholly, and the others explain nothing of the first.
    """
    others, known = sorted(set(offsets) - set(scaffold.poses)), scaffold.known
    seen = [explained_share(known, tracks[name], offsets[name]) for name in others]
    if len(others) < FEWEST_CAMERAS or max(seen) > CHANCE_SHARE or not _whole(scaffold):
        return None
    try:
        own = build({name: tracks[name] for name in others}, {name: offsets[name] for name in others})
    except CalibrationError:
        return None
    if len(own.poses) < len(others) or not _whole(own):
        return None
    here, there = " and ".join(sorted(scaffold.poses)), " and ".join(others)
    what = f"{here} fit one another and so do {there}, but no object was seen by both for long enough"
    return Why(Cause.VIEWS, "", what, "fly one object where all of them see it at the same time")


def _whole(scaffold: Scaffold) -> bool:
    return min(pose.share for pose in scaffold.poses.values()) >= WHOLE_SHARE


def _wrong_in_all(inputs: Inputs, tracks: Tracks, offsets: dict[str, float]) -> Why | None:
    """The picture size that all lens files are not of: read so, every camera fits one scaffold nearly wholly."""
    aligned = sorted(offsets)
    if not any(_one_thing(tracks, offsets, pair) for pair in combinations(aligned, 2)):
        return None
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


def _one_thing(tracks: Tracks, offsets: dict[str, float], pair: tuple[str, str]) -> bool:
    """Whether two cameras see one thing at a time, but for clutter: else most pairs of their tracks are of two
    things, and however they are read no pose explains most rows.
    """
    one, two = pair
    t_s = common(tracks[one], tracks[two], offsets[one], offsets[two], sys.maxsize).t_s
    return len(np.unique(t_s)) >= GOOD_SHARE * max(len(t_s), 1)
