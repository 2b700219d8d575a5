"""Several explanations of one contradiction, each gone on with as if it were true, and compared by what it then costs.

The hazard is the straight line. Whose position is wrong is judged where the adjustment has settled, as if everything
changed in proportion; a tripod typed 48 m too low, in a square of four, then looks as well like any of the others typed
wrong. Gone on with for real, the wrong explanations bend the flight, and cost what the right one does not.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from calib.adjustment.bundle import Adjusted, settle
from calib.adjustment.flight import FlightEstimate
from calib.adjustment.problem import Problem
from calib.adjustment.weights import Weights
from calib.errors import CalibrationError
from calib.geometry.rotation import rotation
from calib.geometry.similarity import HOLD_A_FRAME, Similarity, about, fit_similarity
from calib.observations import SiteCamera
from calib.solving.bootstrap import in_frame
from calib.solving.doubts import Claim
from calib.solving.level import levels, log_likelihood
from calib.solving.strain import CERTAIN, UNLIKELY, Believed, most_probable_first, widening
from edge.common.arrays import Array

MOST_RIVALS: Final = 6  # explanations that are gone on with; more are as good as nobody's
TURNS_RAD: Final = np.radians(np.arange(-60.0, 61.0)).tolist()  # an adjustment goes on from within a degree
LIKELIER: Final = 20.0  # times: less is no reason to turn a world over
OFFERED: Final = 2.0  # squared sigmas that a rival costs more than the cheapest, from which on it is tried from there
ROWS: Final = 2000  # enough for a hundred unknowns; each rival costs an adjustment


def told_apart(
    adjusted: Adjusted, problem: Problem, sites: dict[str, SiteCamera], doubts: tuple[Believed, ...]
) -> tuple[Believed, ...]:
    """The doubts that are left once each of several has been gone on with by itself."""
    certain = tuple(one for one in doubts if one.probability >= CERTAIN)
    rivals = tuple(one for one in doubts if one.probability < CERTAIN)
    if not 2 <= len(rivals) <= MOST_RIVALS:
        return doubts
    coarse = problem.thinned(max(1, problem.row_count // ROWS))
    weights = replace(adjusted.weights, interval_s=coarse.interval_s)
    alone = [replace(coarse, widened=widening((*certain, one.as_likeliest), coarse.prior)) for one in rivals]
    try:
        settled = _settled(adjusted.estimate, alone, rivals, sites, weights)
    except CalibrationError:
        return doubts  # so little is known without it that nothing can be told
    support = [
        np.log(one.as_likeliest.doubt.odds) + log_likelihood(levels(estimate.cameras, sites).value) - cost / 2
        for one, (estimate, cost) in zip(rivals, settled, strict=True)
    ]
    share = np.exp(np.array(support) - max(support))
    share *= sum(one.probability for one in rivals) / share.sum()
    left = [replace(one, probability=float(p)) for one, p in zip(rivals, share, strict=True) if p > UNLIKELY]
    return most_probable_first((*certain, *left))


def _settled(
    estimate: FlightEstimate,
    alone: list[Problem],
    rivals: tuple[Believed, ...],
    sites: dict[str, SiteCamera],
    weights: Weights,
) -> list[tuple[FlightEstimate, float]]:
    """Where each rival settles, and at what cost.

    A better flight that one of them finds on its way is offered to all: it has nothing to do with what they differ in,
    and would be taken for evidence. Raises CalibrationError.
    """
    pairs = list(zip(alone, rivals, strict=True))
    settled = [settle(problem, started(estimate, problem, sites, (one,)), weights) for problem, one in pairs]
    best, least = min(settled, key=lambda found: found[1])
    for index, (problem, one) in enumerate(pairs):
        if settled[index][1] - least > OFFERED:
            again = settle(problem, started(best, problem, sites, (one,)), weights)
            settled[index] = min(settled[index], again, key=lambda found: found[1])
    return settled


def started(
    estimate: FlightEstimate, problem: Problem, sites: dict[str, SiteCamera], doubts: Iterable[Believed]
) -> FlightEstimate:
    """The estimate where the survey puts it without the positions that are doubted.

    Two are left of three: then it hangs on the line between them, and is turned about it to where pictures are level.
    From upside down or askew no adjustment finds there, for a tripod that is lifted changes the shape no more than one
    that is lowered.
    """
    doubted = {name for one in doubts if one.doubt.claim is Claim.POSITION for name in one.doubt.cameras}
    used = [
        index
        for index, prior in enumerate(problem.priors)
        if prior.centre_information.any() and prior.mean.id not in doubted
    ]
    centres = np.array([estimate.cameras[index].centre_enu for index in used])
    if len(used) >= HOLD_A_FRAME:
        surveyed = np.array([problem.priors[index].mean.centre_enu for index in used])
        return turned(estimate, fit_similarity(centres, surveyed).similarity)
    return _levelled(estimate, sites, centres) if len(used) == 2 and doubted else estimate


def _levelled(estimate: FlightEstimate, sites: dict[str, SiteCamera], centres: Array) -> FlightEstimate:
    """The estimate turned about the line between two centres (2, 3) to where its pictures are level."""
    along = (centres[1] - centres[0]) / np.linalg.norm(centres[1] - centres[0])

    def at(angle_rad: float) -> FlightEstimate:
        return turned(estimate, about(centres[0], rotation(angle_rad * along)))

    def support(angle_rad: float) -> float:
        return log_likelihood(levels(at(angle_rad).cameras, sites).value)

    best = max(TURNS_RAD, key=lambda angle: (round(support(angle), 6), -abs(angle)))
    return at(best) if support(best) > support(0.0) + np.log(LIKELIER) else estimate


def turned(estimate: FlightEstimate, similarity: Similarity) -> FlightEstimate:
    """Cameras and flight after a similarity of the world."""
    cameras = tuple(in_frame(camera, similarity) for camera in estimate.cameras)
    control: Array = similarity.apply(estimate.control)
    return replace(estimate, cameras=cameras, control=control)
