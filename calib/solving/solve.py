"""A calibration's steps, one call: inputs, clocks, attempts from one or several beginnings, solution.

The hazard is a calibration that fails without saying why. Each step may refuse with a reason and a next action; a
camera that does not fit is left out, named, and tried again once the others are refined, because a lens or a clock that
is two per cent off looks hopeless before.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.adjustment.uncertainty import camera_covariance
from calib.network import Network
from calib.observations import Scene
from calib.solving.attempts import attempted, best_attempt
from calib.solving.clock_consensus import Clock
from calib.solving.clocks import NEAR_S
from calib.solving.common_time import Timed, on_one_time
from calib.solving.evidence import gather
from calib.solving.findings import findings
from calib.solving.initial_estimate import at_pace, from_network
from calib.solving.inputs import prepare
from calib.solving.reasons import why_left_out
from calib.solving.refine import Refined
from calib.solving.solution import (
    Solution,
    SolutionReport,
    camera_reports,
    rms_px,
    weakest,
)

KNOTS_S: Final = 0.5  # between knots: a UAV's acceleration changes in about that time


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
    observations or the survey do not determine the network, or contradict one another.
    """
    lenses = {camera.id: camera.lens for camera in start.cameras} if start else None
    inputs = prepare(scene, local=options.local, lenses=lenses)
    if start:
        timed = Timed(inputs, {})
        attempt = attempted(timed, from_network(inputs, start), options.knots_s)
    else:
        timed = on_one_time(inputs, local=options.local, near_s=options.clock_search_s)
        attempt = best_attempt(timed, options.knots_s, local=options.local)
    report = _report(timed, attempt.refined, evidence=options.evidence)
    return Solution(timed.as_stamped(attempt.network), attempt.trajectory, report)


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
        findings=(
            *inputs.found,
            *timed.found,
            *(turn.found(inputs.t_mid_unix_ns) for turn in refined.turns),
            *findings(cameras, inputs.sites, refined.strain),
        ),
        strain=refined.strain,
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
