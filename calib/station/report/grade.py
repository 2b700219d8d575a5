"""How good a calibration is, as a grade, and the one thing that would improve it most. Pure.

The hazard is a good grade for a bad network: residuals of a tenth of a pixel say nothing if the flight was flat or a
position is mistyped. So each thing that can be wrong has a mark of its own, the grade is the worst of them, and the
advice is that mark's; only when none is left does the advice come from where the uncertainty comes from.
"""

from typing import Final

from calib.solving.findings import CAUSES, accused
from calib.solving.found import Found
from calib.solving.strain import Strain
from calib.station.report.summary import CameraSummary, FlightSummary, Mark, PairSummary, Predicted, SurveySummary

GRADES: Final = "ABCDE"
# Upper bounds of A, B, C, D. Two metres is what the live station refuses by default (calibration.max_sigma_m).
SIGMA_M: Final = (0.5, 1.0, 2.0, 5.0)
HELD_OUT_RATIO: Final = (1.5, 2.0, 3.0, 5.0)  # of the expected error: sigmas that are half of the truth are a C
OUTLIER_SHARE: Final = (0.15, 0.3, 0.4, 0.5)  # below half inliers the adjustment itself leaves a camera out
PATTERN_SHARE: Final = (0.5, 0.8, 1.2, 2.0)  # of the noise: a lens's error, as large as the noise, does not average
UNCROSSED_SHARE: Final = (0.8, 0.9, 0.95, 0.98)  # of the image: outside what was crossed the lens is the file's word
CENTRE_SIGMA_M: Final = (0.1, 0.25, 0.5, 1.0)  # RTK and a short walk give 0.03; half a metre moves a target as much
CLOCK_OFF_S: Final = (0.02, 0.2, 2.0, 20.0)  # chrony over Wi-Fi keeps 2 ms; half a frame is 17 ms
CLOCK_RATE: Final = (2e-4, 2e-3, 1e-2, 1e-1)  # a crystal keeps 1e-4; more is a wrong frame rate
TO_BE_TESTED: Final = "survey every camera, and fly wider and higher where all cameras see it"
SHARED_ROWS: Final = 100  # of a pair: a few seconds, below which it holds nothing together


def grade_of(value: float, bounds: tuple[float, ...]) -> str:
    """A if value is within the first bound, and so on; E beyond the last."""
    return GRADES[sum(value > bound for bound in bounds)]


def marks(
    cameras: list[CameraSummary],
    left_out: dict[str, str],
    pairs: list[PairSummary],
    flight: FlightSummary,
    *,
    survey: SurveySummary | None,
    claims: Mark,
    weakest: Mark,
) -> list[Mark]:
    """All marks, in the order in which one would mend things. claims, weakest: those of `claims` and `weakest`."""
    return [
        _present(cameras, left_out),
        claims,
        _surveyed(survey),
        _clocks(cameras),
        _outliers(cameras),
        _held_out(cameras),
        _lenses(cameras),
        _coverage(cameras),
        _connected(cameras, pairs),
        weakest,
        _precision(flight),
    ]


def worst(found: list[Mark]) -> Mark:
    """The mark that decides."""
    return max(found, key=lambda mark: GRADES.index(mark.grade))


def verdict(found: list[Mark]) -> str:
    """One sentence about all of it."""
    decisive = worst(found)
    return "nothing speaks against it" if decisive.grade == "A" else f"{decisive.name}: {decisive.reason}"


def improvement(found: list[Mark], predicted: Predicted) -> str:
    """The one thing that would improve it most."""
    decisive = worst(found)
    if decisive.grade != "A":
        return decisive.action
    if predicted.pixel_share is None:
        return f"turn the cameras so that two see the sky {predicted.distance_m:.0f} m away"
    if predicted.pixel_share > 0.5:
        return "stand the cameras farther apart, or use longer lenses: what is left is mostly the pixels' own noise"
    return (
        f"fly more of what {predicted.worst_camera} sees, far and near, high and low: "
        "its pose and lens add most of what is left uncertain"
    )


def _present(cameras: list[CameraSummary], left_out: dict[str, str]) -> Mark:
    if left_out:
        name, why = next(iter(left_out.items()))
        return Mark(name="cameras", grade="C", reason=f"{name} is left out: {why}", action=f"mend {name}: {why}")
    if len(cameras) == 3:
        return Mark(
            name="cameras",
            grade="B",
            reason="with three cameras a fault shows, but not whose it is",
            action="add a fourth camera",
        )
    return Mark(name="cameras", grade="A", reason=f"all {len(cameras)} take part", action="")


def _surveyed(survey: SurveySummary | None) -> Mark:
    if survey is None:
        return Mark(
            name="survey",
            grade="C",
            reason="fewer than three surveyed positions took part, so nothing tests them",
            action="survey every camera's position with RTK",
        )
    # Whose position is wrong, and whether any is, the claims say: one good survey in a hundred looks so by chance.
    return Mark(
        name="survey",
        grade="A" if survey.passed else "B",
        reason=survey.words,
        action=""
        if survey.passed
        else "fly wider, or add a camera: then the cameras' own shape tests the survey"
        if survey.passed is None
        else "measure the tripod with the largest misfit again, and check its antenna's height and offset to the lens",
    )


def claims(strain: Strain | None, findings: tuple[Found, ...]) -> Mark:
    """Whether what is claimed of the site (survey, lens files, clocks) can be; findings: of the calibration."""
    undecided = next((one for one in findings if one.undecided), None)
    if undecided is not None:
        return _claims("D", undecided.sentence, undecided.cure)
    if strain is None or strain.freedom == 0:
        return _claims(
            "B", "not tested: nothing that is claimed can be held against what the cameras saw", TO_BE_TESTED
        )
    if strain.certain:
        cause, cameras = CAUSES[strain.certain[0].claim], accused(strain.certain[0])
        named = next(one for one in findings if (one.cause, one.cameras) == (cause, cameras))
        return _claims("C", named.sentence, named.cure)
    return _claims("A", f"survey, lens files and clocks agree with what the cameras saw {strain.figures}", "")


def _claims(grade: str, reason: str, action: str) -> Mark:
    return Mark(name="claims", grade=grade, reason=reason, action=action)


def _clocks(cameras: list[CameraSummary]) -> Mark:
    off = max(cameras, key=lambda c: abs(c.clock_offset_s))
    rate = max(cameras, key=lambda c: abs(c.clock_rate))
    by_rate = grade_of(abs(rate.clock_rate), CLOCK_RATE)
    if by_rate > grade_of(abs(off.clock_offset_s), CLOCK_OFF_S):
        return Mark(
            name="clocks",
            grade=by_rate,
            reason=f"the clock of {rate.id} runs {rate.clock_rate * 1e6:+.0f} ppm off",
            action=f"check the frame rate that {rate.id} states, or stamp its frames with chrony's time",
        )
    return Mark(
        name="clocks",
        grade=grade_of(abs(off.clock_offset_s), CLOCK_OFF_S),
        reason=f"the farthest off is {off.id}, by {off.clock_offset_s * 1e3:+.0f} ms; it is allowed for",
        action=f"discipline the clock of {off.id} (chrony): what is allowed for today is another error tomorrow",
    )


def _outliers(cameras: list[CameraSummary]) -> Mark:
    most = min(cameras, key=lambda c: c.inlier_share)
    return Mark(
        name="outliers",
        grade=grade_of(1 - most.inlier_share, OUTLIER_SHARE),
        reason=f"{most.id} has most: {1 - most.inlier_share:.0%} of its rows",
        action=f"look at what {most.id} detects: mask what moves but does not fly, raise its score",
    )


def _held_out(cameras: list[CameraSummary]) -> Mark:
    tested = [(c.held_out_px / c.expected_px, c) for c in cameras if c.held_out_px and c.expected_px]
    if not tested:
        return Mark(
            name="held-out rows",
            grade="B",
            reason="no camera's rows could be predicted from two others",
            action="fly where three cameras see it at once",
        )
    ratio, camera = max(tested, key=lambda entry: entry[0])
    return Mark(
        name="held-out rows",
        grade=grade_of(ratio, HELD_OUT_RATIO),
        reason=f"rows of {camera.id} that were held back lie {camera.held_out_px:.2f} px from where the others put "
        f"them; {camera.expected_px:.2f} px were expected",
        action=f"trust the sigmas less by that; look for what no sigma knows: a lens file of {camera.id} for another "
        "zoom or resolution, a tripod that moved, two objects taken for one",
    )


def _lenses(cameras: list[CameraSummary]) -> Mark:
    share, camera = max(((c.pattern_px / c.sigma_px, c) for c in cameras), key=lambda entry: entry[0])
    return Mark(
        name="lenses",
        grade=grade_of(share, PATTERN_SHARE),
        reason=f"{camera.id} misses by {camera.pattern_px:.2f} px depending on the place in the image, "
        f"of {camera.sigma_px:.2f} px in all",
        action=f"calibrate the lens of {camera.id} again (edge-node lens), with the board in every corner",
    )


def _coverage(cameras: list[CameraSummary]) -> Mark:
    least = min(cameras, key=lambda c: c.coverage)
    return Mark(
        name="image crossed",
        grade=grade_of(1 - least.coverage, UNCROSSED_SHARE),
        reason=f"the object crossed {least.coverage:.0%} of the image of {least.id}, the least of all",
        action=f"fly through more of what {least.id} sees, its corners too",
    )


def _connected(cameras: list[CameraSummary], pairs: list[PairSummary]) -> Mark:
    partners = {
        camera.id: sum(p.shared_rows >= SHARED_ROWS for p in pairs if camera.id in (p.one, p.other))
        for camera in cameras
    }
    lonely = min(partners, key=lambda name: partners[name])
    enough = partners[lonely] >= min(2, len(cameras) - 1)
    return Mark(
        name="shared flight",
        grade="A" if enough else "D",
        reason=f"every camera shares the object with at least {partners[lonely]} others"
        if enough
        else f"{lonely} shares the object with {partners[lonely]} others only",
        action=f"fly where {lonely} and two others see it together",
    )


def weakest(camera: str, sigma_m: float, direction: str) -> Mark:
    """The least certain camera's, in its least certain direction, in words."""
    return Mark(
        name="weakest direction",
        grade=grade_of(sigma_m, CENTRE_SIGMA_M),
        reason=f"{camera} is least certain {direction}, by {sigma_m:.2f} m",
        action=f"survey {camera} better, or move a camera out of the line of the others",
    )


def _precision(flight: FlightSummary) -> Mark:
    return Mark(
        name="precision",
        grade=grade_of(flight.sigma_m, SIGMA_M),
        reason=f"positions of the flight are known to {flight.sigma_m:.2f} m, nine of ten to {flight.often_m:.2f} m",
        action="fly wider and higher where all cameras see it, and stand the cameras farther apart",
    )
