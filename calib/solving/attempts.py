"""Several beginnings, each gone on with to the end, and the one that explains most at least cost.

The hazard is the first answer. An adjustment settles in the basin it began in, and says nothing of the others. Where
an answer is firm (it knows the distance to a hundredth, and nothing of what it was told had to be doubted) no other
is looked for. Where it is not, the survey gives beginnings of its own, and cameras in a line are rolled about it. Two
answers that differ and explain as much are no answer.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final

import numpy as np

from calib.adjustment.bundle import settle
from calib.errors import CalibrationError, ContradictionError, UndeterminedError
from calib.geometry.similarity import HOLD_A_FRAME
from calib.network import Camera, Network
from calib.solving.beginnings import from_survey, rolled
from calib.solving.common_time import Timed
from calib.solving.initial_estimate import InitialEstimate, begun, from_scaffold
from calib.solving.inputs import FEWEST_CAMERA_ROWS
from calib.solving.parallax import refuse_parallel_rays
from calib.solving.readmit import readmit
from calib.solving.refine import NOTHING_WITH_IT, Refined, first_weights, problem_of, refine
from calib.solving.refusals import open_share, refuse
from calib.solving.solution import Trajectory, network_of, trajectory_of
from calib.solving.strain import CERTAIN

FIRM_SHARE: Final = 0.01  # of the distance, one sigma: beyond it the neighbouring basins are not far
LINE_FLATNESS: Final = 0.15  # second over first extent of the surveyed positions: below it they are rolled
SCREENED_ROWS: Final = 800  # that beginnings are compared by before one is gone on with
SCREENING_STEPS: Final = 12  # of adjusting them: the right one is next to settled by then
GONE_ON_WITH: Final = 2  # beginnings besides the first
UNDECIDED_COST: Final = 10.0  # squared sigmas: an answer that costs less than this more stays possible
APART_SIGMAS: Final = 3.0  # median distance of two flights from one another that makes them two answers


@dataclass(frozen=True)
class Attempt:
    """One beginning gone on with to the end."""

    refined: Refined
    network: Network
    trajectory: Trajectory

    @property
    def firm(self) -> bool:
        """Whether no other basin need be looked for."""
        strained = self.refined.strain
        doubted = strained is not None and any(one.probability < CERTAIN for one in strained.doubts)
        return open_share(self.network, self.trajectory) < FIRM_SHARE and not doubted

    def cost_against(self, other: "Attempt") -> float:
        """How much more this one costs than the other, in squared sigmas: noise of the same rows, and strain."""
        correlation_s = max(one.refined.adjusted.weights.correlation_s for one in (self, other))
        return self._cost(correlation_s) - other._cost(correlation_s)

    def _cost(self, correlation_s: float) -> float:
        adjusted = self.refined.adjusted
        rows = np.array([len(seen.t_s) for seen in self.refined.problem.data])
        independent = rows / np.maximum(1.0, correlation_s / adjusted.weights.interval_s)
        strained = self.refined.strain
        return float(2 * (independent * np.log(adjusted.weights.sigma_px)).sum()) + (
            strained.statistic if strained else 0
        )


def best_attempt(timed: Timed, knots_s: float, *, local: bool) -> Attempt:
    """The answer of the beginning that explains most. Raises CalibrationError with what is missing."""
    refuse_parallel_rays(timed.inputs.tracks, timed.clocks)
    found: list[Attempt] = []
    refused: list[CalibrationError] = []
    beginnings = chain([None], _others(timed, found, knots_s) if not local else [])
    for beginning in beginnings:
        try:
            found.append(attempted(timed, beginning or _first(timed, local=local), knots_s))
        except ContradictionError:
            raise
        except CalibrationError as refusal:
            refused.append(refusal)
    if found:
        return _decided(found)
    # Whatever stopped the first, that another settles and is open to infinity is nearer to the cause.
    raise next((one for one in refused if isinstance(one, UndeterminedError)), refused[0])


def _first(timed: Timed, *, local: bool) -> InitialEstimate:
    """Raises CalibrationError, with the clocks that are missing where too few cameras are left."""
    try:
        return from_scaffold(timed.inputs, timed.clocks, local=local)
    except ContradictionError:
        raise
    except CalibrationError as error:
        raise timed.blamed(error) from error


def attempted(timed: Timed, initial: InitialEstimate, knots_s: float) -> Attempt:
    """Go on with one beginning to the end. Raises CalibrationError."""
    inputs = timed.inputs
    refined = _readmitted(timed, refine(inputs, initial, knots_s), knots_s)
    adjusted, problem, scene = refined.adjusted, refined.problem, inputs.scene
    network = network_of(adjusted, problem, scene.site, scene.origin, inputs.t_mid_unix_ns)
    trajectory = trajectory_of(adjusted, problem, inputs.t_mid_unix_ns)
    refuse(network, trajectory, inputs, refined.strain)
    return Attempt(refined, network, trajectory)


def _readmitted(timed: Timed, refined: Refined, knots_s: float) -> Refined:
    """Cameras that were left out or taken out, each tried once against the refined flight.

    One that comes back has a pose of its own.
    """
    tried: set[str] = set()
    inputs = timed.inputs
    while True:
        objects = dict(refined.initial.objects)
        untried = {name: own for name, own in refined.initial.tracks.items() if name not in tried}
        back = readmit(refined.adjusted.estimate, untried, inputs.sites, objects, timed.clocks)
        if not back:
            return refined
        tried |= {camera.id for camera in back}
        cameras = tuple(sorted((*refined.adjusted.estimate.cameras, *back), key=lambda camera: camera.id))
        try:
            again = refine(inputs, replace(refined.initial, cameras=cameras, objects=objects), knots_s)
        except CalibrationError:
            # One more that spoils everything stays out, and the others are what they were.
            spoiling = {camera.id: NOTHING_WITH_IT for camera in back}
            refined = replace(refined, left_out={**refined.left_out, **spoiling})
            continue
        left_out, turns = {**refined.left_out, **again.left_out}, (*refined.turns, *again.turns)
        refined = replace(again, left_out=left_out, turns=turns)


def _others(timed: Timed, found: list[Attempt], knots_s: float) -> Iterator[InitialEstimate]:
    """The likeliest other beginnings, if what the first has come to is not firm. found: what it has come to, so far."""
    first = found[0] if found else None
    if first is not None and first.firm and not _in_a_line(timed, first.network.cameras):
        return
    screened: list[tuple[float, int, InitialEstimate]] = []
    for initial in _beginnings(timed, first):
        try:
            problem, estimate = problem_of(timed.inputs, initial, knots_s)
            if min(len(seen.t_s) for seen in problem.data) < FEWEST_CAMERA_ROWS:
                continue
            coarse = problem.thinned(max(1, problem.row_count // SCREENED_ROWS))
            cost = settle(coarse, estimate, first_weights(coarse, estimate), SCREENING_STEPS)[1]
            screened.append((cost, len(screened), initial))
        except CalibrationError:
            continue
    yield from (initial for _, _, initial in sorted(screened, key=lambda one: one[:2])[:GONE_ON_WITH])


def _beginnings(timed: Timed, first: Attempt | None) -> Iterator[InitialEstimate]:
    yield from (begun(timed.inputs, cameras, timed.clocks) for cameras in from_survey(timed.inputs, timed.clocks))
    if first is not None and _in_a_line(timed, first.network.cameras):
        estimate = first.refined.adjusted.estimate
        for cameras in rolled(estimate.cameras, timed.inputs.sites):
            yield replace(first.refined.initial, cameras=cameras, doubts=())


def _in_a_line(timed: Timed, cameras: tuple[Camera, ...]) -> bool:
    sites = [timed.inputs.sites[camera.id] for camera in cameras]
    surveyed = np.array([site.position_enu for site in sites if site.position_enu is not None])
    if len(surveyed) < HOLD_A_FRAME or any(site.up_cam is not None for site in sites):
        return False
    extent = np.linalg.svd(surveyed - surveyed.mean(0), compute_uv=False)
    return bool(extent[1] < LINE_FLATNESS * extent[0])


def _decided(found: list[Attempt]) -> Attempt:
    """The cheapest; raises CalibrationError if another one says something else and costs hardly more."""
    best = found[0]
    for one in found[1:]:
        if one.cost_against(best) < 0:
            best = one
    for one in found:
        if one is not best and one.cost_against(best) < UNDECIDED_COST and (apart_m := _apart_m(one, best)):
            raise CalibrationError(
                "two answers explain what the cameras saw equally well, and put the object "
                f"{apart_m:.0f} m from one another",
                where=best.network.site,
                action="stand the cameras farther apart, fly nearer to them, or say where up is (up_cam)",
            )
    return best


def _apart_m(one: Attempt, two: Attempt) -> float:
    """Median distance between two flights, 0 if their sigmas allow it."""
    _, at, other = np.intersect1d(one.trajectory.t_unix_ns, two.trajectory.t_unix_ns, return_indices=True)
    if len(at) == 0:
        return 0.0
    apart = np.linalg.norm(one.trajectory.points_enu[at] - two.trajectory.points_enu[other], axis=1)
    total = one.trajectory.covariance_enu[at] + two.trajectory.covariance_enu[other]
    sigma = np.sqrt(np.trace(total, axis1=1, axis2=2))
    return float(np.median(apart)) if np.median(apart / sigma) > APART_SIGMAS else 0.0
