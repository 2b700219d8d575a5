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
from calib.solving.clock_consensus import Clock
from calib.solving.clocks import NEAR_S
from calib.solving.common_time import Timed, on_one_time
from calib.solving.evidence import gather
from calib.solving.findings import contradiction, findings
from calib.solving.georeference import CHECK_UP, OVERTURNED
from calib.solving.initial_estimate import InitialEstimate, at_pace, from_network, from_scaffold
from calib.solving.inputs import Inputs, prepare
from calib.solving.readmit import readmit
from calib.solving.reasons import why_left_out
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
from calib.solving.strain import BEYOND_DOUBT, Strain
from calib.solving.upright import upside_down

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
        initial = _begun(timed, options)
    refined = refine(timed.inputs, initial, options.knots_s)
    refined = _readmitted(timed, refined, options)
    return _answer(timed, refined, options)


def _begun(timed: Timed, options: SolveOptions) -> InitialEstimate:
    """Raises CalibrationError, with the clocks that are missing where too few cameras are left."""
    try:
        return from_scaffold(timed.inputs, timed.clocks, local=options.local)
    except CalibrationError as error:
        raise timed.blamed(error) from error


def _readmitted(timed: Timed, refined: Refined, options: SolveOptions) -> Refined:
    """Cameras that were left out or taken out, each tried once against the refined flight.

    One that comes back has a pose of its own.
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
        )
        again = refine(inputs, initial, options.knots_s)
        refined = replace(again, left_out={**refined.left_out, **again.left_out})


def _answer(timed: Timed, refined: Refined, options: SolveOptions) -> Solution:
    inputs = timed.inputs
    adjusted, problem, scene = refined.adjusted, refined.problem, inputs.scene
    network = timed.as_stamped(network_of(adjusted, problem, scene.site, scene.origin, inputs.t_mid_unix_ns))
    trajectory = trajectory_of(adjusted, problem, inputs.t_mid_unix_ns)
    _refuse_strained(network, refined.strain)
    _refuse_overturned(network, trajectory, inputs)
    _refuse_absurd(network, trajectory, refined.strain)
    return Solution(network, trajectory, _report(timed, refined, evidence=options.evidence))


def _refuse_strained(network: Network, found: Strain | None) -> None:
    """Raises CalibrationError for priors that contradict the cameras in a way that nothing known explains."""
    if found is not None and found.p_value_allowed < BEYOND_DOUBT:
        raise CalibrationError(
            f"survey, lens files and clocks contradict what the cameras saw {found.figures}, and no one of them alone "
            "explains it",
            where=network.site,
            action="check that each camera has its own lens file, position and tracks",
        )


def _refuse_overturned(network: Network, trajectory: Trajectory, inputs: Inputs) -> None:
    """Raises CalibrationError for a world upside down; a local frame has no up."""
    if all(inputs.sites[camera.id].position_enu is None for camera in network.cameras):
        return
    ups = {camera.id: up for camera in network.cameras if (up := inputs.sites[camera.id].up_cam) is not None}
    if ups:
        overturned = [c.id for c in network.cameras if c.id in ups and float(c.R_cam_enu[:, 2] @ ups[c.id]) < 0]
        if overturned:
            raise CalibrationError(
                f"{', '.join(overturned)}: by survey and flight up is where its up_cam says down is",
                where=network.site,
                action="correct up_cam, or look for exchanged positions",
            )
        return
    centres = np.array([camera.centre_enu for camera in network.cameras])
    if upside_down([camera.R_cam_enu for camera in network.cameras], centres, trajectory.points_enu):
        raise CalibrationError(OVERTURNED, where=network.site, action=CHECK_UP)


def _refuse_absurd(network: Network, trajectory: Trajectory, found: Strain | None) -> None:
    """Raises CalibrationError for a network that says itself that it knows nothing."""
    if len(trajectory.points_enu) == 0:
        raise CalibrationError("no two cameras see the object at once", where=network.site, action=FLY_WIDER)
    sigma = np.sqrt(np.trace(trajectory.covariance_enu, axis1=1, axis2=2))
    middle = np.mean([camera.centre_enu for camera in network.cameras], axis=0)
    share = float(np.median(sigma / np.linalg.norm(trajectory.points_enu - middle, axis=1)))
    if share < ABSURD_SHARE:
        return
    if found is not None and found.doubts:
        raise CalibrationError(
            f"{contradiction(found, len(network.cameras))}; without all of these the positions are open by "
            f"{100 * share:.0f} % of the distance",
            where=network.site,
            action="correct what is wrong and solve again",
        )
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
        left_out=_left_out(timed, refined, {camera.id for camera in cameras}),
        findings=(*timed.found, *findings(cameras, inputs.sites, refined.strain)),
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


def _left_out(timed: Timed, refined: Refined, present: set[str]) -> tuple[tuple[str, str], ...]:
    """Every camera of the site that is not in the network, and why."""
    inputs = timed.inputs
    reasons = {name: "" for name in inputs.sites if name not in present}
    reasons |= {name: why for name, why in {**inputs.left_out, **refined.left_out}.items() if name in reasons}
    clocks = {name: timed.clocks.get(name, Clock()) for name in inputs.tracks if name not in inputs.left_out}
    offsets = {name: clock.offset_s for name, clock in clocks.items()}
    tracks = at_pace(inputs.tracks, clocks)
    reasons |= why_left_out(reasons, inputs, tracks, offsets, refined.adjusted.estimate)
    return tuple(sorted(reasons.items()))
