"""Several explanations of one contradiction, each gone on with as if it were true, and compared by what it then costs.

The hazard is the straight line. Whose position is wrong is judged where the adjustment has settled, as if everything
changed in proportion; a tripod typed 48 m too low, in a square of four, then looks as well like any of the others typed
wrong. Gone on with for real, the wrong explanations bend the flight, and cost what the right one does not.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from calib.adjustment.bundle import Adjusted, Problem, settle
from calib.adjustment.flight import FlightEstimate
from calib.errors import CalibrationError
from calib.geometry.similarity import HOLD_A_FRAME, Similarity, fit_similarity
from calib.solving.bootstrap import in_frame
from calib.solving.doubts import Claim
from calib.solving.strain import CERTAIN, UNLIKELY, Believed, most_probable_first, widening
from edge.common.arrays import Array

MOST_RIVALS: Final = 6  # explanations that are gone on with; more are as good as nobody's
ROWS: Final = 2000  # enough for a hundred unknowns; each rival costs an adjustment


def told_apart(adjusted: Adjusted, problem: Problem, doubts: tuple[Believed, ...]) -> tuple[Believed, ...]:
    """The doubts that are left once each of several has been gone on with by itself."""
    certain = tuple(one for one in doubts if one.probability >= CERTAIN)
    rivals = tuple(one for one in doubts if one.probability < CERTAIN)
    if not 2 <= len(rivals) <= MOST_RIVALS:
        return doubts
    coarse = problem.thinned(max(1, problem.row_count // ROWS))
    weights = replace(adjusted.weights, interval_s=coarse.interval_s)
    support = []
    for one in rivals:
        alone = replace(coarse, widened=widening((*certain, one), coarse.prior))
        try:
            _, cost = settle(alone, _started(adjusted.estimate, alone, one), weights)
        except CalibrationError:
            cost = np.inf
        support.append(np.log(one.doubt.odds) - cost / 2)
    if not np.isfinite(max(support)):
        return doubts
    share = np.exp(np.array(support) - max(support))
    share *= sum(one.probability for one in rivals) / share.sum()
    left = [replace(one, probability=float(p)) for one, p in zip(rivals, share, strict=True) if p > UNLIKELY]
    return most_probable_first((*certain, *left))


def _started(estimate: FlightEstimate, problem: Problem, rival: Believed) -> FlightEstimate:
    """The estimate where the survey puts it without the positions that the rival disbelieves."""
    doubted = rival.doubt.cameras if rival.doubt.claim is Claim.POSITION else ()
    used = [
        index
        for index, prior in enumerate(problem.priors)
        if prior.centre_information.any() and prior.mean.id not in doubted
    ]
    if len(used) < HOLD_A_FRAME:
        return estimate
    centres = np.array([estimate.cameras[index].centre_enu for index in used])
    surveyed = np.array([problem.priors[index].mean.centre_enu for index in used])
    return turned(estimate, fit_similarity(centres, surveyed).similarity)


def turned(estimate: FlightEstimate, similarity: Similarity) -> FlightEstimate:
    """Cameras and flight after a similarity of the world."""
    cameras = tuple(in_frame(camera, similarity) for camera in estimate.cameras)
    control: Array = similarity.apply(estimate.control)
    return replace(estimate, cameras=cameras, control=control)
