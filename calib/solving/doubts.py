"""What people get wrong about a site, each as a covariance: by how much more a prior may be off than it claims.

The hazard is the list that is too short: what no hypothesis covers is blamed on the nearest that is there. So every
prior has one for each camera by itself and one for all cameras, and lens files have one for all of a type together.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from typing import Final

import numpy as np

from calib.adjustment.joint_prior import JointPrior, of_one_type
from calib.adjustment.priors import FIXED
from calib.adjustment.projection import CAMERA_SIZE, CENTRE, LENS, OFFSET, RATE, unknowns_of
from edge.common.arrays import Array

SLIPS_M: Final = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)  # of one position: from a false fix to a wrong tripod
HEIGHTS_M: Final = (1.0, 3.0, 10.0, 30.0, 100.0)  # of a height alone: an antenna's, or above the sea for the ellipsoid
# Of all positions: a survey that claims too much, no RTK, coordinates rounded. Finer than the slips of one, because
# as many positions tell it well.
SURVEY_OFF_M: Final = (0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 30.0)
LENS_OFF: Final = (0.02, 0.05, 0.1, 0.2, 0.4)  # of the focal length: another zoom, a guess, another camera's file
BENT: Final = (0.03, 0.1, 0.3)  # of the refined coefficient: distortion left out, or taken out twice
CLOCK_SLIPS_S: Final = (0.01, 0.03, 0.1, 0.3, 1.0)  # of a clock that claimed to be better
SLIGHT_M: Final = 0.3  # of all positions: a float fix, or antennas not quite above their lenses
MOST_PAIRED: Final = 12  # surveyed cameras, up to which every pair is a hypothesis: their number grows as the square
TOO_TIGHT: Final = (0.7, 1.0, 1.5, 2.0, 3.0, 5.0)  # of everything, in claimed sigmas that come on top
RATE_OF_CLOCK: Final = 3e-3  # of a clock that is off by a second, s/s: stamps counted at a wrong rate are off by both
# How often, against a site where all is as claimed. What is rarer has to explain more.
USUAL_ODDS: Final = 1e-2
RARE_ODDS: Final = 3e-3


class Claim(StrEnum):
    """What may be wrong about a camera."""

    POSITION = "position"
    LENS = "lens"
    DISTORTION = "distortion"
    CLOCK = "clock"
    EVERYTHING = "everything"


@dataclass(frozen=True)
class Doubt:
    """That what is claimed is off in these cameras, by `size` (m, share of the focal length, coefficient, s, claimed
    sigmas), one sigma.

    odds: how often that happens, against a site where all is as claimed. together: they are all off by the same.
    vertical: of a position, its height only.
    """

    claim: Claim
    cameras: tuple[str, ...]
    size: float
    odds: float
    together: bool = False
    vertical: bool = False

    @property
    def about(self) -> tuple[Claim, tuple[str, ...], bool]:
        """What it is about, whatever its size. A height that is off is a position that is off."""
        return self.claim, self.cameras, self.together and not self.vertical

    @property
    def room(self) -> tuple[bool, bool, float]:
        """How much it allows for, to compare doubts about the same with."""
        return not self.together, not self.vertical, self.size


def all_doubts(prior: JointPrior) -> Iterator[Doubt]:
    """Everything that people get wrong, in every size."""
    names = tuple(one.mean.id for one in prior.cameras)
    surveyed = tuple(one.mean.id for one in prior.cameras if one.centre_information.any())
    timed = tuple(one.mean.id for one in prior.cameras if one.sigma[OFFSET] < max(CLOCK_SLIPS_S))
    yield from _each(Claim.POSITION, surveyed, SLIPS_M, USUAL_ODDS)
    yield from _each(Claim.POSITION, surveyed, HEIGHTS_M, USUAL_ODDS, vertical=True)
    yield from _pairs(surveyed)
    yield from _each(Claim.LENS, names, LENS_OFF, USUAL_ODDS)
    yield from _each(Claim.DISTORTION, names, BENT, RARE_ODDS)
    yield from _each(Claim.CLOCK, timed, CLOCK_SLIPS_S, USUAL_ODDS)
    yield from _all(Claim.POSITION, surveyed, SURVEY_OFF_M, USUAL_ODDS)
    yield from _all(Claim.LENS, names, LENS_OFF, USUAL_ODDS)
    yield from _all(Claim.CLOCK, timed, CLOCK_SLIPS_S, RARE_ODDS)
    yield from _all(Claim.EVERYTHING, names, TOO_TIGHT, USUAL_ODDS)
    for alike in _types(prior):
        yield from _all(Claim.LENS, alike, LENS_OFF, USUAL_ODDS, together=True)
        yield from _all(Claim.DISTORTION, alike, BENT, RARE_ODDS, together=True)


def _each(
    claim: Claim, names: tuple[str, ...], sizes: tuple[float, ...], odds: float, *, vertical: bool = False
) -> Iterator[Doubt]:
    for name in names:
        for size in sizes:
            yield Doubt(claim, (name,), size, odds / len(sizes), vertical=vertical)


def _pairs(names: tuple[str, ...]) -> Iterator[Doubt]:
    """Two at once: exchanged, they are as far off as the tripods stand apart; or both heights, by the same."""
    pairs = list(combinations(names, 2)) if len(names) <= MOST_PAIRED else []
    for pair in pairs:
        for size in SLIPS_M:
            yield Doubt(Claim.POSITION, pair, size, RARE_ODDS / len(pairs) / len(SLIPS_M))
        for size in HEIGHTS_M:
            odds = RARE_ODDS / len(pairs) / len(HEIGHTS_M)
            yield Doubt(Claim.POSITION, pair, size, odds, together=True, vertical=True)


def _all(
    claim: Claim, names: tuple[str, ...], sizes: tuple[float, ...], odds: float, *, together: bool = False
) -> Iterator[Doubt]:
    if len(names) > 1:
        for size in sizes:
            yield Doubt(claim, names, size, odds / len(sizes), together)


def _types(prior: JointPrior) -> list[tuple[str, ...]]:
    """Groups of cameras of one type, each once."""
    found = {
        tuple(two.mean.id for two in prior.cameras if two is one or of_one_type(one.mean, two.mean))
        for one in prior.cameras
    }
    return sorted(group for group in found if len(group) > 1)


def slight_in_all(doubt: Doubt, prior: JointPrior) -> bool:
    """Whether a doubt is of all surveyed positions, and no larger than RTK without a steady fix.

    All of them are then weighed as claimed among themselves, and the estimate is no worse for it; only its sigma is.
    """
    surveyed = {one.mean.id for one in prior.cameras if one.centre_information.any()}
    return doubt.claim is Claim.POSITION and set(doubt.cameras) == surveyed and doubt.size <= SLIGHT_M


def directions(doubt: Doubt, prior: JointPrior) -> Array:
    """(14 C, r) what the doubt moves, for a size of one: its covariance is size^2 times this times its transpose."""
    size = CAMERA_SIZE * len(prior.cameras)
    if doubt.claim is Claim.EVERYTHING:
        everything = np.zeros((size, int(prior.known.sum())))
        everything[prior.known] = np.linalg.cholesky(prior.claimed)
        return everything
    columns = []
    for index, one in enumerate(prior.cameras):
        if one.mean.id in doubt.cameras:
            own = np.zeros((size, 3))
            own[unknowns_of(index)] = _moves(doubt.claim, one.mean.lens.intrinsics)
            if doubt.vertical:
                own[:, :2] = 0.0
            if doubt.claim is Claim.CLOCK and one.sigma[OFFSET] == FIXED:
                own = _all_others_clocks(index, prior)
            columns.append(own)
    if not columns:
        return np.zeros((size, 1))
    # Off by the same: one draw moves all. Off each by itself: a draw for each camera.
    return np.asarray(sum(columns) if doubt.together else np.hstack(columns), float)


def _moves(claim: Claim, intrinsics: tuple[float, float, float, float]) -> Array:
    """(14, 3) the unknowns (rows) that each way of being off (columns) moves."""
    moves = np.zeros((CAMERA_SIZE, 3))
    fx, fy = intrinsics[:2]
    focal = LENS.start
    if claim is Claim.POSITION:
        moves[CENTRE] = np.eye(3)
    elif claim is Claim.CLOCK:
        moves[OFFSET, 0], moves[RATE, 1] = 1.0, RATE_OF_CLOCK
    elif claim is Claim.DISTORTION:
        moves[LENS.stop - 1, 0] = 1.0
    else:
        moves[focal, 0], moves[focal + 1, 0] = fx, fy
        moves[focal + 2, 1], moves[focal + 3, 2] = fx / 4, fy / 4  # a principal point moves less than a zoom
    return moves


def _all_others_clocks(index: int, prior: JointPrior) -> Array:
    """(14 C, 3) what a wrong clock moves whose time is the site's: all the others', the other way."""
    moves = np.zeros((CAMERA_SIZE * len(prior.cameras), 3))
    for other in range(len(prior.cameras)):
        if other != index:
            moves[unknowns_of(other)] = -_moves(Claim.CLOCK, prior.cameras[other].mean.lens.intrinsics)
    return moves
