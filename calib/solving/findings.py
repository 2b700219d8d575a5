"""What a calibration has found out that its user did not know: clocks beyond their bounds, lenses that were off.

The hazard is the correction that is made in silence. An adjustment that moves a clock by half a second has repaired a
flight, and left the box to spoil the next one.
"""

from typing import Final

import numpy as np

from calib.observations import SiteCamera
from calib.solving.clock_words import SIGNIFICANT, clock_words
from calib.solving.doubts import Claim, Doubt
from calib.solving.found import Cause, Found
from calib.solving.solution import CameraReport
from calib.solving.strain import Strain

OFF_LENS: Final = 0.025  # of the focal length: more than lens files are usually good for
CAUSES: Final = {
    Claim.POSITION: Cause.POSITION,
    Claim.LENS: Cause.LENS,
    Claim.DISTORTION: Cause.LENS,
    Claim.CLOCK: Cause.CLOCK,
    Claim.EVERYTHING: Cause.POSITION,  # nobody's in particular: the sentence says so
}
SUBJECTS: Final = {
    Claim.POSITION: "surveyed position",
    Claim.LENS: "lens file",
    Claim.DISTORTION: "distortion",
    Claim.CLOCK: "clock",
    Claim.EVERYTHING: "survey, lens files and clocks",
}
CURES: Final = {
    Claim.POSITION: "survey {it} again",
    Claim.LENS: "calibrate {it} (edge-node lens), at the resolution and zoom that is flown with",
    Claim.DISTORTION: "calibrate the lens (edge-node lens), and give raw pixels, not undistorted ones",
    Claim.CLOCK: "look at the time synchronisation of {whose}",
    Claim.EVERYTHING: "state wider sigmas, or look at each of them",
}
CORRECT: Final = "correct what is wrong, and solve again"
MOST_TOLD: Final = 5  # explanations that are given one by one
EXCHANGED: Final = 0.1  # of the distance between two tripods, within which each stands where the other was surveyed


def findings(
    cameras: tuple[CameraReport, ...], sites: dict[str, SiteCamera], strained: Strain | None
) -> tuple[Found, ...]:
    """What is off, the most serious first."""
    doubts = strained.doubts if strained else ()
    told = {(one.doubt.claim, name) for one in doubts for name in one.doubt.cameras}
    found = _doubted(strained, {camera.id: camera for camera in cameras}) if strained else []
    for camera in cameras:
        if (Claim.CLOCK, camera.id) not in told:
            found += [Found(Cause.CLOCK, (camera.id,), sentence) for sentence in clock_words(camera, sites[camera.id])]
        if (Claim.LENS, camera.id) not in told:
            found += [Found(Cause.LENS, (camera.id,), sentence) for sentence in _lens(camera)]
    return tuple(found)


def _doubted(strained: Strain, cameras: dict[str, CameraReport]) -> list[Found]:
    """What of the priors was not believed: by name where one explanation is left, else that they contradict."""
    found = [_alone(doubt, cameras) for doubt in strained.certain]
    if rivals := strained.rivals:
        names = tuple(sorted({name for doubt in rivals for name in doubt.cameras}))
        sentence = f"{contradiction(strained, len(cameras))}; none of these was believed"
        found.append(Found(CAUSES[rivals[0].claim], names, sentence, undecided=True, cure=CORRECT))
    return found


def contradiction(strained: Strain, cameras: int) -> str:
    """That survey, lens files and clocks contradict the cameras, and who may be wrong. cameras: how many there are."""
    words = list(dict.fromkeys(_is_off(doubt, cameras) for doubt in strained.rivals or strained.certain))
    what = f"what is claimed of the site contradicts what the cameras saw {strained.figures}"
    if len(words) > MOST_TOLD:
        return f"{what}, and nobody can tell where"
    apart = "" if len(words) == 1 else "; these cannot be told apart"
    return f"{what}: {', or '.join(words)}{apart}"


def _is_off(doubt: Doubt, cameras: int) -> str:
    several = len(doubt.cameras) > 1
    subject = "surveyed height" if doubt.vertical else SUBJECTS[doubt.claim]
    if doubt.claim is Claim.EVERYTHING:
        return f"{subject} of {_whose(doubt, cameras)} are less certain than they claim"
    return f"the {subject}{'s' if several else ''} of {_whose(doubt, cameras)} {'are' if several else 'is'} off"


def _whose(doubt: Doubt, cameras: int) -> str:
    """The cameras in words. cameras: how many there are."""
    everybody = 1 < len(doubt.cameras) == cameras
    return "all cameras" if everybody else " and ".join(doubt.cameras)


def accused(doubt: Doubt) -> tuple[str, ...]:
    """Whom a doubt that stands alone is about: nobody, if it is about everything."""
    return () if doubt.claim is Claim.EVERYTHING else doubt.cameras


def _alone(doubt: Doubt, cameras: dict[str, CameraReport]) -> Found:
    """The finding about the one thing that is wrong."""
    cause = CAUSES[doubt.claim]
    if _exchanged(doubt, cameras):
        sentence = f"the positions of {' and '.join(doubt.cameras)} are exchanged, and neither was believed"
        return Found(cause, doubt.cameras, sentence, cure="exchange them in the survey")
    it, was = ("it", "was") if len(doubt.cameras) == 1 else ("them", "were")
    sentence = f"{_is_off(doubt, len(cameras))}{_by_how_much(doubt, cameras)} and {was} not believed"
    cure = CURES[doubt.claim].format(it=it, whose=_whose(doubt, len(cameras)))
    return Found(cause, accused(doubt), sentence, cure=cure)


def _by_how_much(doubt: Doubt, cameras: dict[str, CameraReport]) -> str:
    """The number, where there is one for all."""
    camera = cameras.get(doubt.cameras[0])
    if camera is None or (len(doubt.cameras) > 1 and not doubt.together):
        return ""
    if doubt.claim is Claim.POSITION and camera.survey_misfit_m is not None:
        return f" by {np.linalg.norm(camera.survey_misfit_m):.2f} m"
    if doubt.claim is Claim.LENS:
        return f" by {100 * (camera.lens_before.intrinsics[0] / camera.lens_after.intrinsics[0] - 1):+.1f} %"
    if doubt.claim is Claim.CLOCK:
        return f" by {-camera.clock_offset_s:+.3f} s"
    return ""


def _exchanged(doubt: Doubt, cameras: dict[str, CameraReport]) -> bool:
    """Whether two positions that are doubted are each other's."""
    if doubt.claim is not Claim.POSITION or len(doubt.cameras) != 2:
        return False
    one, two = (cameras.get(name) for name in doubt.cameras)
    return one is not None and two is not None and _in_each_others_place(one, two)


def _in_each_others_place(one: CameraReport, two: CameraReport) -> bool:
    if one.survey_misfit_m is None or two.survey_misfit_m is None:
        return False
    here, there = np.array(one.centre_enu), np.array(two.centre_enu)
    surveyed_here, surveyed_there = here - one.survey_misfit_m, there - two.survey_misfit_m
    apart_m = float(np.linalg.norm(here - there))
    off_m = max(np.linalg.norm(here - surveyed_there), np.linalg.norm(there - surveyed_here))
    return bool(off_m < EXCHANGED * apart_m)


def _lens(camera: CameraReport) -> list[str]:
    before, after = np.array(camera.lens_before.intrinsics[:2]), np.array(camera.lens_after.intrinsics[:2])
    change = after / before - 1
    sigma = np.array(camera.sigma_lens[:2]) / before
    worst = int(np.argmax(np.abs(change)))
    if abs(change[worst]) > OFF_LENS and abs(change[worst]) > SIGNIFICANT * sigma[worst]:
        return [
            f"the focal length of {camera.id} is {100 * change[worst]:+.1f} % off its lens file: calibrate the lens"
        ]
    return []
