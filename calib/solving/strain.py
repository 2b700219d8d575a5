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
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calib.adjustment.bundle import Adjusted, Problem
from calib.adjustment.joint_prior import JointPrior
from calib.adjustment.projection import centre_of
from calib.adjustment.uncertainty import settled_covariance
from calib.geometry.similarity import HOLD_A_FRAME
from calib.solving.doubts import Doubt, all_doubts, directions
from calib.solving.survey_check import TESTABLE
from edge.common.arrays import Array

UNSURE: Final = 0.1  # probability that all is as claimed, below which it is not taken to be so
UNLIKELY: Final = 0.02  # probability of a doubt, below which it is not allowed for
CERTAIN: Final = 0.95  # probability from which on a doubt stands alone
LARGEST_SIZE: Final = 0.05  # of a doubt's probability: the largest size that has as much is allowed for
BEYOND_DOUBT: Final = 1e-6  # chance of priors being so strained, when nothing that people get wrong explains it
AT_ONCE: Final = 3  # things that are wrong at once, each hidden by the other


@dataclass(frozen=True)
class Believed:
    """A doubt, in the largest size that is not unlikely, and how probable it is given what was seen."""

    doubt: Doubt
    probability: float


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


@dataclass(frozen=True)
class PixelInformation:
    """What the pixels alone say of the known unknowns, linearised where an adjustment has settled.

    scale: (K',) sigmas as claimed, the units of the rest. information: (K', K'). pull: (K',) information times how far
    the pixels' own estimate lies from the priors' means.
    """

    scale: Array
    information: Array
    pull: Array

    @classmethod
    def of(cls, adjusted: Adjusted, problem: Problem) -> "PixelInformation":
        """From an adjustment, whatever its priors claimed: their part is taken out again."""
        prior = problem.prior
        scale = np.sqrt(np.diag(prior.claimed))
        at = np.ix_(prior.known, prior.known)
        both = np.linalg.inv(settled_covariance(adjusted, problem)[at] / np.outer(scale, scale))
        away = prior.deviation(adjusted.estimate.cameras)[prior.known] / scale
        by_prior = np.linalg.inv(prior.covariance / np.outer(scale, scale))
        return cls(scale, both - by_prior, both @ away)

    def about(self, chosen: NDArray[np.bool_], claimed: Array) -> "PixelInformation":
        """What they say of some unknowns (K',), where the others are as claimed (K', K') and independent of these."""
        rest = ~chosen
        others = self.information[np.ix_(rest, rest)]
        others = others + np.linalg.inv(claimed[np.ix_(rest, rest)] / np.outer(self.scale[rest], self.scale[rest]))
        carried = np.linalg.solve(others, self.information[np.ix_(rest, chosen)]).T
        information = self.information[np.ix_(chosen, chosen)] - carried @ self.information[np.ix_(rest, chosen)]
        return PixelInformation(self.scale[chosen], information, self.pull[chosen] - carried @ self.pull[rest])

    def against(self, covariance: Array) -> "PriorTest":
        """How far priors of this covariance (K', K') are off, in the directions that the pixels know.

        In units of such a prior (P^-1 = L^-T L^-1) an adjustment moves it by z = L' h, with covariance
        W = 1 - L' C L. Along an eigenvector of W the prior is off by z / w, known with a variance of 1 / w.
        """
        root = np.linalg.cholesky(np.linalg.inv(covariance / np.outer(self.scale, self.scale)))
        adjusted = np.linalg.inv(self.information + root @ root.T)
        values, vectors = np.linalg.eigh(np.eye(len(root)) - root.T @ (adjusted + adjusted.T) @ root / 2)
        tested = values > TESTABLE
        values, vectors = values[tested], vectors[:, tested]
        moved = vectors.T @ (root.T @ (adjusted @ self.pull))
        return PriorTest(moved / values, 1 / values, (root @ vectors) / self.scale[:, None])


@dataclass(frozen=True)
class PriorTest:
    """Priors against pixels: how far off (k,), with which variance (k,), and (K', k) what brings any further
    covariance of the priors into that frame.
    """

    off: Array
    variance: Array
    frame: Array

    @property
    def freedom(self) -> int:
        """k: 0 if the pixels know too little to test anything."""
        return len(self.off)

    @property
    def statistic(self) -> float:
        """Chi-square with k degrees of freedom, if the priors are as good as they say."""
        return float((self.off**2 / self.variance).sum())

    @property
    def p_value(self) -> float:
        """The chance of priors that are as good as they say looking so strained."""
        return float(stats.chi2.sf(self.statistic, self.freedom)) if self.freedom else 1.0

    def log_likelihood(self, parts: Array) -> float:
        """Of what was seen, if the priors' covariance is larger by parts @ parts.T; parts: (K', r)."""
        within = self.frame.T @ parts
        weighted = within / self.variance[:, None]
        inner = np.eye(parts.shape[1]) + within.T @ weighted
        pull = weighted.T @ self.off
        quadratic = self.statistic - float(pull @ np.linalg.solve(inner, pull))
        return -0.5 * (quadratic + float(np.log(self.variance).sum() + np.linalg.slogdet(inner)[1]))


def strain(adjusted: Adjusted, problem: Problem) -> Strain:
    """Test what survey, lens files and clocks claim, and weigh what may be wrong with them."""
    if not problem.prior.known.any():
        return Strain(0.0, 0, 1.0, (), 1.0)
    return Weighing(problem.prior, PixelInformation.of(adjusted, problem)).strain()


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
    """What priors claim, and what the pixels alone say of it: which doubts are likely."""

    prior: JointPrior
    seen: PixelInformation

    @cached_property
    def _parts(self) -> dict[Doubt, Array]:
        """(K', r) by doubt."""
        found = {one: one.size * directions(one, self.prior)[self.prior.known] for one in all_doubts(self.prior)}
        return {one: parts for one, parts in found.items() if parts.any()}

    def strain(self) -> Strain:
        """The test of the priors as claimed, and what is doubted: a cause at a time, each hidden by the one before."""
        claimed = self.seen.against(self.prior.claimed)
        allowed = claimed
        doubts: tuple[Believed, ...] = ()
        for _ in range(AT_ONCE):
            more = self._likely(allowed)
            if not more:
                break
            doubts = (*doubts, *more)
            known = np.ix_(self.prior.known, self.prior.known)
            allowed = self.seen.against(self.prior.claimed + widening(doubts, self.prior)[known])
        return Strain(claimed.statistic, claimed.freedom, claimed.p_value, doubts, allowed.p_value)

    def posterior(self, tested: PriorTest) -> tuple[float, dict[Doubt, float]]:
        """How probable it is that all is as claimed, and how probable each doubt, given what was seen: 1 together."""
        as_claimed = tested.log_likelihood(np.zeros((len(tested.frame), 1)))
        support = [np.log(d.odds) + tested.log_likelihood(parts) - as_claimed for d, parts in self._parts.items()]
        every = np.array([0.0, *support])
        probability = np.exp(every - every.max())
        nothing, *each = (probability / probability.sum()).tolist()
        return nothing, dict(zip(self._parts, each, strict=True))

    def _likely(self, tested: PriorTest) -> tuple[Believed, ...]:
        """What is not unlikely, if it is likely that something is wrong; nothing otherwise.

        Everything, where each is as unlikely as all the others.
        """
        as_claimed, probability = self.posterior(tested)
        if as_claimed > UNSURE:
            return ()
        every = list(_of_any_size(probability))
        return most_probable_first([one for one in every if one.probability > UNLIKELY] or every)


def _of_any_size(probability: dict[Doubt, float]) -> Iterator[Believed]:
    """One doubt for all the sizes of one: the largest that is not unlikely, as probable as all of them."""
    about: dict[object, dict[Doubt, float]] = {}
    for doubt, own in probability.items():
        about.setdefault(doubt.about, {})[doubt] = own
    for sizes in about.values():
        total = sum(sizes.values())
        yield Believed(max((d for d in sizes if sizes[d] >= LARGEST_SIZE * total), key=lambda d: d.size), total)


def most_probable_first(doubts: Iterable[Believed]) -> tuple[Believed, ...]:
    """In the same order wherever probabilities are equal but for their rounding."""
    return tuple(sorted(doubts, key=lambda one: (-round(one.probability, 6), one.doubt.about)))
