"""What a report says, as one struct: report.json is this, and report.html shows nothing else in words and tables.

The hazard is two truths again: a page that rounds, judges or counts by itself will one day disagree with the file
beside it. So every number is made here, once, in SI units and the frames its name says.
"""

from typing import Final

import msgspec
import numpy as np

from calib.errors import CalibrationError
from calib.solving.evidence import Evidence, HeldOut
from calib.solving.found import Cause
from calib.solving.prediction import PredictedAccuracy, directions, middle, predict
from calib.solving.solution import CameraReport, Solution
from calib.solving.strain import Strain
from calib.solving.survey_check import FALSE_ALARM
from edge.common.arrays import Array

REPORT_FORMAT: Final = 1  # of report.json; raised when a field changes its meaning
DISTANCES_M: Final = (100.0, 300.0, 1000.0)
MIDDLE_DISTANCE_M: Final = 300.0
SURVEY_WORDS: Final = {
    True: "survey and cameras agree",
    False: "the surveyed positions lie farther from the shape that the cameras see than they should",
    None: "not tested: the cameras know the shape of the site no better than nothing",
}
OFTEN: Final = 90.0  # percentile: nine directions of ten are better


class CameraSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One camera; sigmas are one sigma.

    held_out_px: rows it had to predict; expected_px: what that was expected to be; fitted_px: the same rows when they
    took part. pattern_px: mean residuals by place in the image, root mean square. coverage: share of the image crossed.
    """

    id: str
    rows: int
    inlier_share: float
    sigma_px: float
    sigma_mrad: float
    correlated_s: float
    held_out_px: float | None
    expected_px: float | None
    fitted_px: float | None
    pattern_px: float
    coverage: float
    clock_offset_s: float
    sigma_offset_s: float
    clock_rate: float
    sigma_rate: float
    readout_s: float
    sigma_readout_s: float
    lens_model: str
    intrinsics_before: tuple[float, float, float, float]
    intrinsics_after: tuple[float, float, float, float]
    k1_before: float
    k1_after: float
    sigma_lens: tuple[float, float, float, float, float]
    centre_enu: tuple[float, float, float]
    sigma_centre_m: tuple[float, float, float]
    sigma_attitude_rad: tuple[float, float, float]
    survey_misfit_m: tuple[float, float, float] | None


class PairSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Two cameras and the rows in which both saw the same object."""

    one: str
    other: str
    shared_rows: int


class Predicted(msgspec.Struct, frozen=True, kw_only=True):
    """At one distance from the middle of the cameras, over the directions that two of them see.

    sigma_m: median of one sigma in 3D (root of the trace); often_m: nine directions of ten are better. seen_share: of
    the directions that do not lead below the lowest camera. pixel_share: of the variance, from the pixels' noise.
    """

    distance_m: float
    sigma_m: float | None
    often_m: float | None
    horizontal_m: float | None
    vertical_m: float | None
    seen_share: float
    pixel_share: float | None
    worst_camera: str | None  # whose pose and lens add most


class FlightSummary(msgspec.Struct, frozen=True, kw_only=True):
    """What was flown and how well it is known: one sigma in 3D, median and nine rows of ten."""

    rows: int
    tracks: int
    seconds: float
    span_m: tuple[float, float, float]
    speed_m_s: float
    sigma_m: float
    often_m: float


class SurveySummary(msgspec.Struct, frozen=True, kw_only=True):
    """The surveyed positions against the cameras: chi-square and its degrees of freedom.

    passed: null where nothing could be tested. suspect: the camera whose position alone is found wrong, if there is
    one; wrong_by_m: east, north, up.
    """

    statistic: float
    freedom: int
    p_value: float
    passed: bool | None
    suspect: str | None
    wrong_by_m: tuple[float, float, float] | None
    words: str


class ClaimsSummary(msgspec.Struct, frozen=True, kw_only=True):
    """All that is claimed of the site (survey, lens files, clocks) against what the cameras saw.

    p_value: chance of such a chi-square if all is as claimed; p_value_allowed: with what was doubted allowed for.
    """

    statistic: float
    freedom: int
    p_value: float
    p_value_allowed: float


class Mark(msgspec.Struct, frozen=True, kw_only=True):
    """A grade A to E for one thing, why, and what would raise it."""

    name: str
    grade: str
    reason: str
    action: str


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """The whole report."""

    format: int
    site: str
    origin: tuple[float, float, float]
    network: str
    grade: str
    verdict: str
    improvement: str
    marks: list[Mark]
    findings: list[str]
    left_out: dict[str, str]
    rms_px: float
    survey_rms_m: float | None
    survey: SurveySummary | None
    claims: ClaimsSummary | None
    flight: FlightSummary
    weakest_camera: str
    weakest_sigma_m: float
    weakest_direction_enu: tuple[float, float, float]
    predicted: list[Predicted]
    cameras: list[CameraSummary]
    pairs: list[PairSummary]


def evidence_of(solution: Solution) -> Evidence:
    """The evidence, which a report needs. Raises CalibrationError if it was not gathered."""
    if solution.report.evidence is None:
        raise CalibrationError(
            "no evidence was gathered", where=solution.network.site, action="solve with SolveOptions(evidence=True)"
        )
    return solution.report.evidence


def camera_summaries(solution: Solution) -> list[CameraSummary]:
    """One a camera, in the network's order."""
    evidence = evidence_of(solution)
    return [
        _camera(camera, held, place.pattern_px, place.coverage)
        for camera, held, place in zip(solution.report.cameras, evidence.held_out, evidence.by_place, strict=True)
    ]


def _camera(camera: CameraReport, held: HeldOut | None, pattern_px: float, coverage: float) -> CameraSummary:
    before, after = camera.lens_before, camera.lens_after
    return CameraSummary(
        id=camera.id,
        rows=camera.rows,
        inlier_share=camera.inlier_share,
        sigma_px=camera.sigma_px,
        sigma_mrad=1e3 * camera.sigma_px / float(np.sqrt(after.intrinsics[0] * after.intrinsics[1])),
        correlated_s=camera.correlated_s,
        held_out_px=held.predicted_px if held else None,
        expected_px=held.expected_px if held else None,
        fitted_px=held.fitted_px if held else None,
        pattern_px=pattern_px,
        coverage=coverage,
        clock_offset_s=camera.clock_offset_s,
        sigma_offset_s=camera.sigma_offset_s,
        clock_rate=camera.clock_rate,
        sigma_rate=camera.sigma_rate,
        readout_s=camera.readout_s,
        sigma_readout_s=camera.sigma_readout_s,
        lens_model=after.model,
        intrinsics_before=before.intrinsics,
        intrinsics_after=after.intrinsics,
        k1_before=before.refined_coefficient,
        k1_after=after.refined_coefficient,
        sigma_lens=camera.sigma_lens,
        centre_enu=camera.centre_enu,
        sigma_centre_m=camera.sigma_centre_m,
        sigma_attitude_rad=camera.sigma_attitude_rad,
        survey_misfit_m=camera.survey_misfit_m,
    )


def pair_summaries(solution: Solution) -> list[PairSummary]:
    """Every pair once; of the two counts the smaller, which is the slower camera's."""
    shared, names = evidence_of(solution).shared_rows, [camera.id for camera in solution.report.cameras]
    return [
        PairSummary(one=names[i], other=names[j], shared_rows=int(min(shared[i, j], shared[j, i])))
        for i in range(len(names))
        for j in range(i + 1, len(names))
    ]


def flight_summary(solution: Solution) -> FlightSummary:
    """Extent, speed and uncertainty of what was flown."""
    flown = solution.trajectory
    sigma = np.sqrt(np.trace(flown.covariance_enu, axis1=1, axis2=2))
    east, north, up = np.ptp(flown.points_enu, axis=0).tolist()
    return FlightSummary(
        rows=len(flown.t_unix_ns),
        tracks=len(np.unique(flown.track)),
        seconds=solution.report.flight_s,
        span_m=(east, north, up),
        speed_m_s=_speed_m_s(solution),
        sigma_m=float(np.median(sigma)),
        often_m=float(np.percentile(sigma, OFTEN)),
    )


def _speed_m_s(solution: Solution) -> float:
    flown = solution.trajectory
    order = np.lexsort((flown.t_unix_ns, flown.track))
    seconds = np.diff(flown.t_unix_ns[order]) * 1e-9
    same = (np.diff(flown.track[order]) == 0) & (seconds > 0) & (seconds < 0.2)
    hops = np.linalg.norm(np.diff(flown.points_enu[order], axis=0), axis=1)
    return float(np.median(hops[same] / seconds[same])) if same.any() else 0.0


def predict_around(solution: Solution, distance_m: float) -> tuple[Array, PredictedAccuracy]:
    """Directions (N, 3) from the middle of the cameras, and what is predicted at that distance along them."""
    cameras = solution.network.cameras
    sigma_px = np.array([camera.sigma_px for camera in solution.report.cameras])
    around, centre = directions(), middle(cameras)
    lowest = min(float(camera.centre_enu[2]) for camera in cameras)
    around = around[centre[2] + distance_m * around[:, 2] > lowest]
    points = centre + distance_m * around
    return around, predict(cameras, sigma_px, evidence_of(solution).covariance, points)


def predicted(solution: Solution, distance_m: float) -> Predicted:
    """The table's row for one distance."""
    _, prediction = predict_around(solution, distance_m)
    known = prediction.cameras >= 2
    share = float(np.mean(known))
    if not known.any():
        nothing = dict.fromkeys(("sigma_m", "often_m", "horizontal_m", "vertical_m", "pixel_share", "worst_camera"))
        return msgspec.convert({"distance_m": distance_m, "seen_share": share, **nothing}, Predicted)
    total = np.diagonal(prediction.pixels_m2 + prediction.network_m2, axis1=1, axis2=2)[known]
    pixels = np.trace(prediction.pixels_m2, axis1=1, axis2=2)[known]
    names = [camera.id for camera in solution.network.cameras]
    return Predicted(
        distance_m=distance_m,
        sigma_m=float(np.median(prediction.sigma_m[known])),
        often_m=float(np.percentile(prediction.sigma_m[known], OFTEN)),
        horizontal_m=float(np.median(np.sqrt(total[:, 0] + total[:, 1]))),
        vertical_m=float(np.median(np.sqrt(total[:, 2]))),
        seen_share=share,
        pixel_share=float(np.median(pixels / total.sum(axis=1))),
        worst_camera=names[int(np.argmax(np.median(prediction.camera_m2[known], axis=0)))],
    )


def survey_summary(solution: Solution) -> SurveySummary | None:
    """The test of the survey; None if fewer than three positions took part. Whom it accuses, the findings say."""
    tested = evidence_of(solution).survey
    if tested is None:
        return None
    passed = tested.p_value > FALSE_ALARM if tested.freedom else None
    suspect = _alone_off(solution)
    misfit = suspect.survey_misfit_m if suspect else None
    return SurveySummary(
        statistic=tested.statistic,
        freedom=tested.freedom,
        p_value=tested.p_value,
        passed=passed,
        suspect=suspect.id if suspect else None,
        wrong_by_m=(-misfit[0], -misfit[1], -misfit[2]) if misfit else None,
        words=f"{SURVEY_WORDS[passed]} (chi-square {tested.statistic:.1f} of {tested.freedom})",
    )


def _alone_off(solution: Solution) -> CameraReport | None:
    """The one camera whose surveyed position is found wrong."""
    found = [one for one in solution.report.findings if one.cause is Cause.POSITION and not one.undecided]
    names = {name for one in found for name in one.cameras}
    return next((c for c in solution.report.cameras if names == {c.id}), None)


def claims_summary(strain: Strain | None) -> ClaimsSummary | None:
    """The test of what is claimed, in JSON's terms; None in a local frame."""
    if strain is None:
        return None
    return ClaimsSummary(
        statistic=strain.statistic,
        freedom=strain.freedom,
        p_value=strain.p_value,
        p_value_allowed=strain.p_value_allowed,
    )
