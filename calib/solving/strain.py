"""Whether the priors agree with what the cameras saw, and if not, which of them is to be believed less.

The hazard is the prior that gives way in silence. An adjustment moves a lens by eight of its sigmas, because a height
was typed above sea level, and reports the sigma of a flight in which everything was as claimed. How far survey, lenses
and clocks were moved, all together and against how far they may, is a chi-square test (Baarda 1968); but one wrong
number among forty hides in it. So each thing that people get wrong is a hypothesis (`doubts`): it says by how much
more the priors may be off, and what the cameras saw has a likelihood under it. If it is unlikely that all is as
claimed, whatever is not unlikely widens the priors, and everything is adjusted again: where the others determine what
is no longer believed, little is lost, and where they do not, the sigma says so.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from calib.adjustment.bundle import Adjusted
from calib.adjustment.joint_prior import JointPrior
from calib.adjustment.problem import Problem
from calib.adjustment.projection import centre_of
from calib.errors import UndeterminedError
from calib.geometry.similarity import HOLD_A_FRAME
from calib.observations import SiteCamera
from calib.solving.doubts import Claim, Doubt, all_doubts, directions
from calib.solving.level import SITES, levels
from calib.solving.pixel_information import PixelInformation, PriorTest
from edge.common.arrays import Array

UNSURE: Final = 0.1  # probability that all is as claimed, below which it is not taken to be so
UNLIKELY: Final = 0.02  # probability of a doubt, below which it is not allowed for
BLUNDER_SIGMAS: Final = 60.0  # of a position as claimed: metres, where a bad fix of a receiver is off by decimetres
BLUNDER_UNLIKELY: Final = 0.05  # probability of one, below which it is not allowed for where all else is as claimed
CERTAIN: Final = 0.95  # probability from which on a doubt stands alone
LARGEST_SIZE: Final = 0.05  # of a doubt's probability: the largest size that has as much is allowed for
BEYOND_DOUBT: Final = 1e-6  # chance of priors being so strained, when nothing that people get wrong explains it
AT_ONCE: Final = 3  # things that are wrong at once, each hidden by the other


@dataclass(frozen=True)
class Believed:
    """A doubt, with the most room that is not unlikely, and how probable it is given what was seen.

    likeliest: of all that are about the same; None if there is but one.
    """

    doubt: Doubt
    probability: float
    likeliest: Doubt | None = None

    @property
    def as_likeliest(self) -> "Believed":
        """The same with as much room as is likeliest."""
        return replace(self, doubt=self.likeliest or self.doubt)


@dataclass(frozen=True)
class Strain:
    """The test of all priors, as claimed and with the doubts allowed for: chi-square, degrees of freedom, chance.

    doubts: what is more likely than that all is as claimed, most probable first.
    """

    statistic: float
    freedom: int
    p_value: float
    doubts: tuple[Believed, ...]
    p_value_allowed: float

    @property
    def certain(self) -> tuple[Doubt, ...]:
        """What is wrong beyond doubt."""
        return tuple(one.doubt for one in self.doubts if one.probability >= CERTAIN)

    @property
    def rivals(self) -> tuple[Doubt, ...]:
        """Of which one is wrong that cannot be told; none if beside something certain next to nothing is left."""
        left = [one for one in self.doubts if one.probability < CERTAIN]
        some = not self.certain or sum(one.probability for one in left) > 1 - CERTAIN
        return tuple(one.doubt for one in left) if some else ()

    @property
    def figures(self) -> str:
        """The test in brackets."""
        return f"(chi-square {self.statistic:.1f} of {self.freedom})"


def strain(adjusted: Adjusted, problem: Problem, sites: dict[str, SiteCamera]) -> Strain:
    """Test what survey, lens files and clocks claim, and weigh what may be wrong with them."""
    if not problem.prior.known.any():
        return Strain(0.0, 0, 1.0, (), 1.0)
    level = levels(adjusted.estimate.cameras, sites)
    return Weighing(problem.prior, PixelInformation.beside(adjusted, problem, level)).strain()


def survey_test(adjusted: Adjusted, problem: Problem) -> PriorTest | None:
    """The surveyed positions as claimed against all the rest as claimed; None if fewer than three are in use."""
    prior = problem.prior
    surveyed = np.zeros(len(prior.known), bool)
    for index in range(len(prior.cameras)):
        surveyed[centre_of(index)] = True
    chosen = surveyed[prior.known]
    if chosen.sum() < 3 * HOLD_A_FRAME:
        return None
    seen = PixelInformation.of(adjusted, problem).about(chosen, prior.claimed)
    return seen.against(prior.claimed[np.ix_(chosen, chosen)])


def widening(doubts: tuple[Believed, ...], prior: JointPrior) -> Array:
    """(14 C, 14 C) covariance that doubts add to what priors claim."""
    total = np.zeros((len(prior.known), len(prior.known)))
    for one in doubts:
        parts = one.doubt.size * directions(one.doubt, prior)
        total += parts @ parts.T
    return total


@dataclass(frozen=True)
class Weighing:
    """What priors claim, and what the pixels alone say of it: which doubts are likely.

    seen: of the known unknowns, and then of how level each picture is, of as many as that is known of.
    """

    prior: JointPrior
    seen: PixelInformation

    @cached_property
    def _parts(self) -> dict[Doubt, Array]:
        """(K', r) by doubt."""
        found = {one: one.size * directions(one, self.prior)[self.prior.known] for one in all_doubts(self.prior)}
        return {one: parts for one, parts in found.items() if parts.any()}

    def strain(self) -> Strain:
        """The test of the priors as claimed, and what is doubted: a cause at a time, each hidden by the one before."""
        allowed = self.prior.claimed
        doubts: tuple[Believed, ...] = ()
        for _ in range(AT_ONCE):
            more = self._likely(allowed)
            if not more:
                break
            doubts = (*doubts, *more)
            known = np.ix_(self.prior.known, self.prior.known)
            allowed = self.prior.claimed + widening(doubts, self.prior)[known]
        seen = self.seen.first(len(allowed))
        claimed = seen.against(self.prior.claimed)
        # Wider priors are strained no more: anything else is the rounding of hundreds of metres beside centimetres.
        left = max(claimed.p_value, seen.against(allowed).p_value)
        return Strain(claimed.statistic, claimed.freedom, claimed.p_value, doubts, left)

    def posterior(self, covariance: Array) -> tuple[float, dict[Doubt, float]]:
        """How probable it is that priors of this covariance (K', K') are right, and how probable each doubt beside
        it, given what was seen: 1 together. Raises UndeterminedError where an adjustment ran off beyond all numbers.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            support = self._support(covariance)
        if not np.isfinite(support).all():
            raise UndeterminedError(
                "the adjustment ran off to where nothing is determined",
                where="adjustment",
                action="stand the cameras farther apart, or fly nearer to them",
            )
        probability = np.exp(support - support.max())
        nothing, *each = (probability / probability.sum()).tolist()
        return nothing, dict(zip(self._parts, each, strict=True))

    def _support(self, covariance: Array) -> Array:
        """(1 + D,) log of how well each explains what was seen, that all is as claimed first, up to a constant."""
        pictures = len(self.seen.scale) - len(covariance)
        tested = self.seen.against(block_diag(covariance, SITES[0][0] ** 2 * np.eye(pictures)))
        sites = [_on_site(tested, askew_rad, pictures) for askew_rad, _ in SITES]
        as_claimed = np.array([np.log(share) for _, share in SITES]) + [one.log_likelihood for one in sites]
        support = np.array([0.0, *(np.log(doubt.odds) for doubt in self._parts)])
        support[0] += np.logaddexp.reduce(as_claimed)
        for which, parts in self._alike:
            gains = np.array([one.gains(np.pad(parts, ((0, 0), (0, pictures), (0, 0)))) for one in sites])
            support[1 + which] += np.logaddexp.reduce(as_claimed[:, None] + gains)
        return support

    @cached_property
    def _alike(self) -> list[tuple[NDArray[np.int64], Array]]:
        """The parts of doubts that move as many ways: their places among all (D,), and (D, K', r)."""
        ways = np.array([parts.shape[1] for parts in self._parts.values()])
        every = list(self._parts.values())
        groups = [np.flatnonzero(ways == count) for count in np.unique(ways)]
        return [(which, np.stack([every[index] for index in which])) for which in groups]

    def _likely(self, covariance: Array) -> tuple[Believed, ...]:
        """What is not unlikely, if it is likely that something is wrong; otherwise only blunders that are not unlikely.

        Everything, where each is as unlikely as all the others.
        """
        as_claimed, probability = self.posterior(covariance)
        if as_claimed > UNSURE:
            every = list(of_any_size({one: p for one, p in probability.items() if self._is_blunder(one)}))
            return most_probable_first(one for one in every if one.probability > BLUNDER_UNLIKELY)
        every = list(of_any_size(probability))
        return most_probable_first([one for one in every if one.probability > UNLIKELY] or every)

    def _is_blunder(self, doubt: Doubt) -> bool:
        """Whether it is of positions, and so large beside what was claimed that no stated sigma would cover it."""
        if doubt.claim is not Claim.POSITION:
            return False
        off = np.sqrt((self._parts[doubt] ** 2).sum(axis=1) / np.diag(self.prior.claimed))
        return bool(off.max() >= BLUNDER_SIGMAS)


def _on_site(tested: PriorTest, askew_rad: float, pictures: int) -> PriorTest:
    """The test where pictures hang as askew as that. tested: on the most level of sites, the pictures' rolls last."""
    more_rad = np.sqrt(askew_rad**2 - SITES[0][0] ** 2)
    return tested.widened(more_rad * np.eye(len(tested.frame))[:, len(tested.frame) - pictures :])


def of_any_size(probability: dict[Doubt, float]) -> Iterator[Believed]:
    """One doubt for all the sizes of one: the largest that is not unlikely, as probable as all of them."""
    about: dict[object, dict[Doubt, float]] = {}
    for doubt, own in probability.items():
        about.setdefault(doubt.about, {})[doubt] = own
    for sizes in about.values():
        total = sum(sizes.values())
        # Of two cameras a pair is all of them: thirty sizes, and where nothing tells them apart none has a twentieth.
        least = min(LARGEST_SIZE * total, max(sizes.values()))
        widest = max((d for d in sizes if sizes[d] >= least), key=lambda d: d.room)
        yield Believed(widest, total, max(sizes, key=lambda d: (round(sizes[d], 6), d.room)))


def most_probable_first(doubts: Iterable[Believed]) -> tuple[Believed, ...]:
    """In the same order wherever probabilities are equal but for their rounding."""
    return tuple(sorted(doubts, key=lambda one: (-round(one.probability, 6), one.doubt.about)))
