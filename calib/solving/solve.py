"""A calibration's steps, one call: inputs, initial estimate, bundle adjustment, readmission, solution.

The hazard is a calibration that fails without saying why. Each step may refuse with a reason and a next action; a
camera that does not fit is left out, named, and tried again once the others are refined, because a lens or a clock that
is two per cent off looks hopeless before.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from calib.adjustment.uncertainty import camera_covariance
from calib.errors import CalibrationError
from calib.network import Network
from calib.observations import Scene
from calib.solving.clocks import NEAR_S
from calib.solving.common_time import Timed, on_one_time
from calib.solving.evidence import gather
from calib.solving.findings import findings
from calib.solving.found import Cause, Found
from calib.solving.initial_estimate import from_network, from_scaffold
from calib.solving.inputs import Inputs, prepare
from calib.solving.readmit import readmit
from calib.solving.refine import Refined, refine
from calib.solving.solution import (
    Solution,
    SolutionReport,
    Trajectory,
    camera_reports,
    network_of,
    rms_px,
    trajectory_of,
    weakest,
)

KNOTS_S: Final = 0.5  # between knots: a UAV's acceleration changes in about that time

ABSURD_SHARE: Final = 0.3  # of the distance, one sigma: a solution that open is none
FLY_WIDER: Final = "fly a path with more width and height that at least three cameras see together"


@dataclass(frozen=True)
class SolveOptions:
    """How to solve.

    local: no survey, a frame of its own with the scaffold's baseline as unit. evidence: gather what the report shows
    besides, which costs about as much as solving. clock_search_s: how far clocks may be off; a camera that aligns
    nowhere within it is searched for within two minutes. knots_s: of the flight's spline.
    """

    local: bool = False
    evidence: bool = False
    clock_search_s: float = NEAR_S
    knots_s: float = KNOTS_S


DEFAULTS: Final = SolveOptions()


def solve(scene: Scene, options: SolveOptions = DEFAULTS, start: Network | None = None) -> Solution:
    """Calibrate a scene.

    start: a network to begin with, instead of a scaffold. Raises CalibrationError, with what to do, if the
    observations or the survey do not determine the network.
    """
    lenses = {camera.id: camera.lens for camera in start.cameras} if start else None
    inputs = prepare(scene, local=options.local, lenses=lenses)
    if start:
        timed = Timed(inputs, {})
        initial = from_network(inputs, start)
    else:
        timed = on_one_time(inputs, local=options.local, near_s=options.clock_search_s)
        initial = from_scaffold(timed.inputs, timed.clocks, local=options.local)
    refined = refine(timed.inputs, initial, options.knots_s)
    refined = _readmitted(timed, refined, options)
    return _answer(timed, refined, options)


def _readmitted(timed: Timed, refined: Refined, options: SolveOptions) -> Refined:
    """Cameras that were left out or taken out, each tried once against the refined flight.

    One that comes back has a pose of its own, so a verdict on its position that rested on the old one is dropped.
    """
    tried: set[str] = set()
    inputs = timed.inputs
    while True:
        objects = dict(refined.initial.objects)
        untried = {name: own for name, own in inputs.tracks.items() if name not in tried}
        back = readmit(refined.adjusted.estimate, untried, inputs.sites, objects, timed.clocks)
        if not back:
            return refined
        names = {camera.id for camera in back}
        tried |= names
        initial = replace(
            refined.initial,
            cameras=tuple(sorted((*refined.adjusted.estimate.cameras, *back), key=lambda camera: camera.id)),
            objects=objects,
            rejected={name: why for name, why in refined.initial.rejected.items() if name not in names},
        )
        again = refine(inputs, initial, options.knots_s)
        refined = replace(again, left_out={**refined.left_out, **again.left_out})


def _answer(timed: Timed, refined: Refined, options: SolveOptions) -> Solution:
    inputs = timed.inputs
    adjusted, problem, scene = refined.adjusted, refined.problem, inputs.scene
    network = timed.as_stamped(network_of(adjusted, problem, scene.site, scene.origin, inputs.t_mid_unix_ns))
    trajectory = trajectory_of(adjusted, problem, inputs.t_mid_unix_ns)
    _refuse_absurd(network, trajectory)
    return Solution(network, trajectory, _report(timed, refined, evidence=options.evidence))


def _refuse_absurd(network: Network, trajectory: Trajectory) -> None:
    """Raises CalibrationError for a network that says itself that it knows nothing."""
    if len(trajectory.points_enu) == 0:
        raise CalibrationError("no two cameras see the object at once", where=network.site, action=FLY_WIDER)
    sigma = np.sqrt(np.trace(trajectory.covariance_enu, axis1=1, axis2=2))
    middle = np.mean([camera.centre_enu for camera in network.cameras], axis=0)
    share = float(np.median(sigma / np.linalg.norm(trajectory.points_enu - middle, axis=1)))
    if not share < ABSURD_SHARE:
        raise CalibrationError(
            f"the flight does not determine the network: positions are open by {100 * share:.0f} % of the distance",
            where=network.site,
            action=FLY_WIDER,
        )


def _report(timed: Timed, refined: Refined, *, evidence: bool) -> SolutionReport:
    inputs, adjusted, problem = timed.inputs, refined.adjusted, refined.problem
    surveyed = {name: site.position_enu for name, site in inputs.sites.items() if site.position_enu is not None}
    adjusted_cameras = camera_reports(
        adjusted, problem, surveyed, {name: site.lens for name, site in inputs.sites.items()}
    )
    cameras = tuple(map(timed.report, adjusted_cameras))
    misfits = np.array([camera.survey_misfit_m for camera in cameras if camera.survey_misfit_m is not None])
    name, sigma, direction = weakest(adjusted, problem)
    return SolutionReport(
        cameras=cameras,
        left_out=_left_out(inputs, refined, {camera.id for camera in cameras}),
        findings=(*_rejected(refined.initial.rejected), *findings(cameras, inputs.sites)),
        rms_px=rms_px(adjusted, problem),
        survey_rms_m=float(np.sqrt((misfits**2).sum(1).mean())) if len(misfits) else None,
        rounds=adjusted.rounds,
        flight_s=float((adjusted.estimate.flight.end_s - adjusted.estimate.flight.start_s).sum()),
        jerk_density=adjusted.weights.jerk_density,
        weakest_camera=name,
        weakest_sigma_m=sigma,
        weakest_direction_enu=direction,
        evidence=gather(adjusted, problem, camera_covariance(adjusted, problem)) if evidence else None,
    )


def _rejected(rejected: dict[str, str]) -> tuple[Found, ...]:
    """One finding for each sentence on surveyed positions that were not used, of all cameras that it is about."""
    return tuple(
        Found(Cause.POSITION, tuple(name for name, why in rejected.items() if why == sentence), sentence)
        for sentence in dict.fromkeys(rejected.values())
    )


def _left_out(inputs: Inputs, refined: Refined, present: set[str]) -> tuple[tuple[str, str], ...]:
    """Every camera of the site that is not in the network, and why."""
    unfit = "no pose explains its track: check its clock, its lens file and what it detects"
    reasons = {name: unfit for name in inputs.sites if name not in present}
    reasons |= {name: why for name, why in {**inputs.left_out, **refined.left_out}.items() if name in reasons}
    return tuple(sorted(reasons.items()))
