"""Bundle adjustment, and the judging of what came of it: which camera is an outlier, which surveyed position is wrong.

The hazard is the average. A camera with the lens file of another, or a tripod whose position was mistyped, bends
everything a little and looks fine in the sum. So after each adjustment every camera has to explain its own rows as well
as the others do theirs, and every surveyed position has to agree with the shape the cameras see. The worst offender is
taken out, named with the evidence, and the rest adjusted again.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.linalg import block_diag

from calib.adjustment.bundle import Adjusted, Problem, adjust
from calib.adjustment.flight import FlightEstimate
from calib.adjustment.priors import FIXED, CameraPrior, camera_priors, held, on_site_time
from calib.adjustment.projection import ROTATION, centre_of
from calib.adjustment.weights import Weights
from calib.errors import CalibrationError
from calib.network import Camera
from calib.solving.bootstrap import first_estimate
from calib.solving.initial_estimate import InitialEstimate
from calib.solving.inputs import FEWEST_CAMERA_ROWS, Inputs
from calib.solving.survey_check import FALSE_ALARM, GAUGE, NetworkCheck, check_survey
from edge.common.arrays import Array

FIRST_SIGMA_RAY: Final = 0.005  # what a first estimate is good for, in ray units
FEWEST_INLIERS: Final = 0.5  # share of a camera's rows within its noise: half clutter is no camera
WITHIN_SIGMAS: Final = 3.0  # 98.9 % of good two-dimensional residuals
COARSEST: Final = 8.0  # times the other cameras' noise, in ray units: a lens or a clock that no refinement mends
SURE: Final = 1e-4  # chance of a good survey looking so wrong, below which a position is taken out and not only named
FEWEST_LEFT: Final = 3  # cameras: fewer would hang on the survey of two
GAUGE_SIGMA: Final = 1e-6  # baselines: holds a local frame without counting as knowledge


@dataclass(frozen=True)
class Refined:
    """The adjustment, its problem, and from where it was begun after all that was taken out. left_out: camera, why."""

    adjusted: Adjusted
    problem: Problem
    initial: InitialEstimate
    left_out: dict[str, str]


def refine(inputs: Inputs, initial: InitialEstimate, knots_s: float) -> Refined:
    """Bundle adjustment, again and again until nothing is left that does not belong.

    Raises CalibrationError if too little is left.
    """
    left_out: dict[str, str] = {}
    weights: Weights | None = None  # of the round before, while the cameras stay the same
    while True:
        problem, estimate = _problem(inputs, initial, knots_s)
        blind = [
            c.id for c, seen in zip(estimate.cameras, problem.data, strict=True) if len(seen.t_s) < FEWEST_CAMERA_ROWS
        ]
        if blind:
            left_out[blind[0]] = "it hardly ever saw an object that another camera saw at the same time"
            initial = _without(initial, initial.cameras, blind[0])
            continue
        if weights is None or len(weights.sigma_px) != len(estimate.cameras):
            weights = _first_weights(problem, estimate)
        try:
            adjusted = adjust(problem, estimate, weights)
        except CalibrationError:
            doubtful = _most_doubtful(initial)
            if doubtful is None:
                raise
            left_out[doubtful] = "with it nothing can be determined: check its lens file, its clock and its frames"
            initial, weights = _without(initial, initial.cameras, doubtful), None
            continue
        outcast = _outcast(adjusted, problem)
        if outcast:
            left_out[outcast[0]] = outcast[1]
            initial, weights = _without(initial, adjusted.estimate.cameras, outcast[0]), None
        elif initial.gauge is None and (wrong := _wrong_position(adjusted, problem)):
            rejected = {**initial.rejected, wrong[0]: wrong[1]}
            initial = replace(initial, cameras=adjusted.estimate.cameras, rejected=rejected)
            weights = adjusted.weights
        else:
            return Refined(adjusted, problem, initial, left_out)


def _most_doubtful(initial: InitialEstimate) -> str | None:
    """The camera whose first pose explained least, if it is worse than the others and three are left without it."""
    shares = {camera.id: initial.shares.get(camera.id, 1.0) for camera in initial.cameras}
    worst = min(sorted(shares), key=lambda name: shares[name])
    enough = len(shares) > FEWEST_LEFT and worst not in (initial.gauge or ())
    return worst if enough and shares[worst] < float(np.median(list(shares.values()))) else None


def _problem(inputs: Inputs, initial: InitialEstimate, knots_s: float) -> tuple[Problem, FlightEstimate]:
    cameras = on_site_time(initial.cameras, inputs.sites)
    priors = camera_priors(cameras, inputs.sites, frozenset(initial.rejected))
    if initial.gauge:
        priors = _local_gauge(priors, initial.gauge)
    cameras = tuple(map(held, cameras, priors))
    estimate, data = first_estimate(
        inputs.scene,
        cameras,
        inputs.tracks,
        initial.objects,
        t_mid=inputs.t_mid_unix_ns,
        spacing_s=knots_s,
    )
    return Problem(data, priors), estimate


def _local_gauge(priors: tuple[CameraPrior, ...], gauge: tuple[str, str]) -> tuple[CameraPrior, ...]:
    """Priors that hold the first camera's pose and the way to the second: seven freedoms no pixel can know."""
    by_id = {prior.mean.id: prior for prior in priors}
    one, two = (by_id[name] for name in gauge)
    along = two.mean.centre_enu - one.mean.centre_enu
    sigma = one.sigma.copy()
    sigma[ROTATION] = FIXED
    by_id[gauge[0]] = replace(one, sigma=sigma, centre_information=np.eye(3) / GAUGE_SIGMA**2)
    by_id[gauge[1]] = replace(two, centre_information=np.outer(along, along) / (along @ along) / GAUGE_SIGMA**2)
    return tuple(by_id[prior.mean.id] for prior in priors)


def _first_weights(problem: Problem, estimate: FlightEstimate) -> Weights:
    hops = np.linalg.norm(np.diff(estimate.control, axis=0), axis=1)
    speed = float(np.median(hops)) / estimate.flight.spacing_s
    sigma = np.array([FIRST_SIGMA_RAY * camera.lens.intrinsics[0] for camera in estimate.cameras])
    return Weights(sigma, problem.interval_s, 0.0, max(speed, 1e-3) ** 2)


def _without(initial: InitialEstimate, cameras: tuple[Camera, ...], name: str) -> InitialEstimate:
    """Begin again without a camera. Raises CalibrationError if fewer than two are left, or it held the frame."""
    cameras = tuple(camera for camera in cameras if camera.id != name)
    if len(cameras) < 2 or name in (initial.gauge or ()):
        raise CalibrationError(
            f"{name} does not fit, and without it nothing can be calibrated",
            where="adjustment",
            action=f"check lens file, clock and detector of {name}",
        )
    objects = {key: number for key, number in initial.objects.items() if key[0] != name}
    return replace(initial, cameras=cameras, objects=objects)


def noise_ray(adjusted: Adjusted) -> Array:
    """(C,) one sigma of each camera's residuals in ray units."""
    focal = np.array([camera.lens.intrinsics[0] for camera in adjusted.estimate.cameras])
    return np.asarray(adjusted.weights.sigma_px / focal, float)


def _outcast(adjusted: Adjusted, problem: Problem) -> tuple[str, str] | None:
    """The camera that explains its rows worst, and how badly; None if all are fit to stay."""
    noise = noise_ray(adjusted)
    for index in np.argsort(-noise).tolist():
        camera, image = adjusted.estimate.cameras[index], adjusted.projected[index]
        others = float(np.median(np.delete(noise, index)))
        sigma = adjusted.weights.sigma_px[index] * problem.data[index].sigma_px
        share = float(np.mean(image.valid & (np.linalg.norm(image.residual, axis=1) < WITHIN_SIGMAS * sigma)))
        if len(noise) > 2 and noise[index] > COARSEST * others:
            return camera.id, (
                f"its rows miss by {1e3 * noise[index]:.1f} mrad where the others miss by {1e3 * others:.2f}: "
                "check its lens file, its clock and what it detects"
            )
        if share < FEWEST_INLIERS:
            return camera.id, (
                f"only {100 * share:.0f} % of its rows are explained by any position of the object: "
                "check what it detects"
            )
    return None


def survey_check(adjusted: Adjusted, problem: Problem) -> NetworkCheck | None:
    """The positions in use against the shape the cameras see; None if fewer than three are in use."""
    used = [index for index, prior in enumerate(problem.priors) if prior.centre_information.any()]
    if 3 * len(used) <= GAUGE:
        return None
    at = np.r_[tuple(centre_of(index) for index in used)]
    return check_survey(
        [adjusted.estimate.cameras[index].id for index in used],
        np.array([problem.priors[index].mean.centre_enu for index in used]),
        block_diag(*(np.linalg.inv(problem.priors[index].centre_information) for index in used)),
        np.array([adjusted.estimate.cameras[index].centre_enu for index in used]),
        adjusted.factor.camera_covariance[np.ix_(at, at)],
    )


def _wrong_position(adjusted: Adjusted, problem: Problem) -> tuple[str, str] | None:
    """A surveyed position that is wrong beyond doubt, and the sentence that says so.

    Beyond doubt: the others agree among themselves once it is gone. Where they still do not, the cameras' own errors
    are larger than they claim, and taking positions out one by one would only bend the network further.
    """
    check = survey_check(adjusted, problem)
    if check is None or check.suspect is None or check.p_value > SURE:
        return None
    others_agree = check.rest_p_value is not None and check.rest_p_value > FALSE_ALARM
    return (check.suspect, f"{check}; it was not used") if others_agree and not check.also else None
