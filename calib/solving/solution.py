"""What a calibration answers: the network, where the object was, and how good all that is.

The hazard is a number without its uncertainty, or with a false one. Every position carries its covariance, with the
errors that all positions share (the cameras') in it; every camera carries what its residuals showed; what was left out
is named with the evidence.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.bundle import Adjusted
from calib.adjustment.problem import Problem
from calib.adjustment.projection import (
    CAMERA_SIZE,
    CENTRE,
    LENS,
    OFFSET,
    RATE,
    READOUT,
    ROTATION,
    centre_of,
    site_time_s,
)
from calib.adjustment.uncertainty import camera_covariance, curved, position_covariance
from calib.geometry.spline import Flight, evaluate
from calib.network import POSE_SIZE, Network
from calib.solving.evidence import Evidence
from calib.solving.found import Found
from calib.solving.series import gap_to_nearest_s
from calib.solving.sole_witnesses import sole_witnesses
from calib.solving.strain import Strain
from edge.common.arrays import Array
from edge.lens import LensModel

ROWS_PER_S: Final = 20  # of a trajectory
SEEN_WITHIN_S: Final = 0.1  # a camera sees the object "then" if one of its rows is this near: 10 Hz cameras count
INSIDE_SIGMAS: Final = 2.5  # a residual within the robust core
SEES_SIGMAS: Final = 4.0  # of a row that bears a position out: beyond, its camera saw something else then
SEES_PX: Final = 1.0  # or so near: of pixels without any noise, sigma says nothing


@dataclass(frozen=True)
class Trajectory:
    """Where the objects were. t_unix_ns, track, cameras: (M,) int64 (cameras: how many saw it then).

    points_enu: (M, 3) metres; covariance_enu: (M, 3, 3) m^2.
    """

    t_unix_ns: NDArray[np.int64]
    track: NDArray[np.int64]
    points_enu: Array
    covariance_enu: Array
    cameras: NDArray[np.int64]


@dataclass(frozen=True)
class CameraReport:
    """What the adjustment says of one camera. survey_misfit_m: (3,) estimate minus survey, ENU, or None.

    sigma_px: of a coordinate; correlated_s: how long its error lives; inlier_share: of its rows, within the noise.
    sigma_*: one sigma of the estimate.
    """

    id: str
    rows: int
    inlier_share: float
    sigma_px: float
    correlated_s: float
    clock_offset_s: float
    sigma_offset_s: float
    clock_rate: float
    sigma_rate: float
    readout_s: float
    sigma_readout_s: float
    lens_before: LensModel
    lens_after: LensModel
    sigma_lens: tuple[float, float, float, float, float]
    centre_enu: tuple[float, float, float]
    sigma_centre_m: tuple[float, float, float]
    sigma_attitude_rad: tuple[float, float, float]
    survey_misfit_m: tuple[float, float, float] | None


@dataclass(frozen=True)
class SolutionReport:
    """How good a calibration is. findings: what was found wrong first. left_out: camera and why.

    strain: the test of what survey, lens files and clocks claim; None in a local frame.
    weakest_sigma_m: the least certain direction of any camera's centre, and weakest_direction_enu (3,) which.
    evidence: residuals by place, held-out residuals, shared rows, the survey's test.
    """

    cameras: tuple[CameraReport, ...]
    left_out: tuple[tuple[str, str], ...]
    findings: tuple[Found, ...]
    strain: Strain | None
    rms_px: float
    survey_rms_m: float | None
    rounds: int
    flight_s: float
    jerk_density: float
    weakest_camera: str
    weakest_sigma_m: float
    weakest_direction_enu: tuple[float, float, float]
    evidence: Evidence | None


@dataclass(frozen=True)
class Solution:
    """A calibration's whole answer."""

    network: Network
    trajectory: Trajectory
    report: SolutionReport


def network_of(
    adjusted: Adjusted, problem: Problem, site: str, origin: tuple[float, float, float], t_mid_unix_ns: int
) -> Network:
    """The calibrated network with the joint covariance of all poses."""
    weights = adjusted.weights
    cameras = tuple(
        replace(camera, sigma_px=float(sigma_px), correlated_s=weights.correlation_s)
        for camera, sigma_px in zip(adjusted.estimate.cameras, weights.sigma_px, strict=True)
    )
    pose = np.concatenate([CAMERA_SIZE * i + np.arange(POSE_SIZE) for i in range(len(cameras))])
    covariance = camera_covariance(adjusted, problem)[np.ix_(pose, pose)]
    alone = sole_witnesses(adjusted, problem)
    return Network(site, origin, t_mid_unix_ns, cameras, covariance, rms_px(adjusted, problem), rests_on=alone)


def rms_px(adjusted: Adjusted, problem: Problem) -> float:
    """Root mean square of the residuals within the noise, px a coordinate."""
    squares = [image.residual[_inside(adjusted, problem, i)] ** 2 for i, image in enumerate(adjusted.projected)]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _inside(adjusted: Adjusted, problem: Problem, index: int) -> NDArray[np.bool_]:
    return _misses(adjusted, problem, index) < INSIDE_SIGMAS


def _bears_out(adjusted: Adjusted, problem: Problem, index: int) -> NDArray[np.bool_]:
    """Which of a camera's rows see the object where the flight has it."""
    image = adjusted.projected[index]
    near: NDArray[np.bool_] = image.valid & (np.linalg.norm(image.residual, axis=1) < SEES_PX)
    return near | (_misses(adjusted, problem, index) < SEES_SIGMAS)


def _misses(adjusted: Adjusted, problem: Problem, index: int) -> Array:
    """(N,) how many sigmas each row of a camera is off the flight; infinite of a ray that the lens does not know."""
    image, sigma = adjusted.projected[index], adjusted.told_sigma_px(index) * problem.data[index].sigma_px
    return np.where(image.valid, np.linalg.norm(image.residual, axis=1) / sigma, np.inf)


def camera_reports(
    adjusted: Adjusted, problem: Problem, surveyed: dict[str, Array], lenses: dict[str, LensModel]
) -> tuple[CameraReport, ...]:
    """One report a camera. surveyed: ENU positions by camera; lenses: before the adjustment."""
    covariance = camera_covariance(adjusted, problem)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0)).reshape(-1, CAMERA_SIZE)
    reports = []
    for index, camera in enumerate(adjusted.estimate.cameras):
        seen, own = problem.data[index], sigma[index]
        misfit = camera.centre_enu - surveyed[camera.id] if camera.id in surveyed else None
        reports.append(
            CameraReport(
                id=camera.id,
                rows=len(seen.t_s),
                inlier_share=float(np.mean(_inside(adjusted, problem, index))),
                sigma_px=float(adjusted.weights.sigma_px[index]),
                correlated_s=adjusted.weights.correlation_s,
                clock_offset_s=camera.clock_offset_s,
                sigma_offset_s=float(own[OFFSET]),
                clock_rate=camera.clock_rate,
                sigma_rate=float(own[RATE]),
                readout_s=camera.readout_s,
                sigma_readout_s=float(own[READOUT]),
                lens_before=lenses[camera.id],
                lens_after=camera.lens,
                sigma_lens=tuple(own[LENS].tolist()),
                centre_enu=tuple(camera.centre_enu.tolist()),
                sigma_centre_m=tuple(own[CENTRE].tolist()),
                sigma_attitude_rad=tuple(own[ROTATION].tolist()),
                survey_misfit_m=None if misfit is None else tuple(misfit.tolist()),
            )
        )
    return tuple(reports)


def weakest(adjusted: Adjusted, problem: Problem) -> tuple[str, float, tuple[float, float, float]]:
    """The camera whose centre is least certain, its largest sigma (m), and the direction of it (ENU)."""
    covariance = camera_covariance(adjusted, problem)
    found = []
    for index, camera in enumerate(adjusted.estimate.cameras):
        at = centre_of(index)
        values, vectors = np.linalg.eigh(covariance[at, at])
        found.append((float(np.sqrt(max(values[-1], 0))), camera.id, vectors[:, -1]))
    sigma, name, direction = max(found, key=lambda entry: entry[0])
    return name, sigma, tuple(direction.tolist())


def trajectory_of(adjusted: Adjusted, problem: Problem, t_mid_unix_ns: int) -> Trajectory:
    """ROWS_PER_S rows a second wherever at least two cameras saw the object there, and more than saw it elsewhere.

    A camera that saw something else, or at another time, bears no position out: where fewer than two agree with the
    flight, it was drawn through between what they say, and its sigma knows nothing of that. Two rays of six nearly meet
    somewhere by chance.
    """
    estimate = adjusted.estimate
    seen, missed = [], []
    for index, (camera, data) in enumerate(zip(estimate.cameras, problem.data, strict=True)):
        agrees, t_s = _bears_out(adjusted, problem, index), site_time_s(camera, data)
        seen.append((t_s[agrees], data.target[agrees]))
        missed.append((t_s[~agrees], data.target[~agrees]))
    step_ns = 10**9 // ROWS_PER_S
    first_row_ns = t_mid_unix_ns - t_mid_unix_ns % step_ns  # rows at whole twentieths of a UTC second
    offset_s = (first_row_ns - t_mid_unix_ns) * 1e-9
    times, stretches, counts = [], [], []
    for piece in range(len(estimate.flight.start_s)):
        instants = _instants(estimate.flight, piece, offset_s)
        between = (estimate.flight.start_s[piece], estimate.flight.end_s[piece])
        sees, misses = (
            _cameras_at(instants, int(estimate.flight.target[piece]), between, rows) for rows in (seen, missed)
        )
        seeing = sees.sum(axis=0)
        told = (seeing >= 2) & (seeing > (misses & ~sees).sum(axis=0))
        times.append(instants[told])
        stretches.append(np.full(int(told.sum()), piece))
        counts.append(seeing[told])
    t, stretch, count = np.concatenate(times), np.concatenate(stretches), np.concatenate(counts)
    located = estimate.flight.locate(t, stretch)
    t_unix_ns = np.round((t - offset_s) * ROWS_PER_S).astype(np.int64) * step_ns + first_row_ns
    target = estimate.flight.target[stretch]
    order = np.lexsort((target, t_unix_ns))
    points = evaluate(located, estimate.control)
    middle = np.mean([camera.centre_enu for camera in estimate.cameras], axis=0)
    return Trajectory(
        t_unix_ns[order],
        target[order],
        points[order],
        curved(position_covariance(adjusted, problem, located), points, middle)[order],
        count[order],
    )


def _instants(flight: Flight, stretch: int, offset_s: float) -> Array:
    first = np.ceil((flight.start_s[stretch] - offset_s) * ROWS_PER_S)
    last = np.floor((flight.end_s[stretch] - offset_s) * ROWS_PER_S)
    return np.arange(first, last + 1) / ROWS_PER_S + offset_s


def _cameras_at(
    t_s: Array, target: int, between: tuple[float, float], seen: list[tuple[Array, NDArray[np.int64]]]
) -> NDArray[np.bool_]:
    """(C, M) which cameras have a row of the object within SEEN_WITHIN_S of each time. seen: rows' times and targets.

    None before its first row in that stretch of flight or after its last: what comes then, nobody saw.
    """
    sees = np.zeros((len(seen), len(t_s)), bool)
    for index, (site, of_target) in enumerate(seen):
        own = np.sort(site[(of_target == target) & (site >= between[0]) & (site <= between[1])])
        if len(own):
            within = (t_s >= own[0]) & (t_s <= own[-1])
            sees[index] = within & (gap_to_nearest_s(t_s, own) <= SEEN_WITHIN_S)
    return sees
