"""What the pixels alone say of what survey, lens files and clocks claim, and how likely that is under any claim.

The hazard is the answer that has already given way: an adjusted position is a compromise between pixels and survey, and
tells neither. So the priors' part is taken out of a settled adjustment again; what is left can be held against any
covariance of the priors without adjusting anew.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calib.adjustment.bundle import LEAST_ADJUSTED_PX, Adjusted
from calib.adjustment.problem import Problem
from calib.adjustment.uncertainty import settled_covariance
from calib.solving.survey_check import TESTABLE
from edge.common.arrays import Array

ROUNDED: Final = 2.0  # times the most negative eigenvalue: below it, an eigenvalue is as likely rounding
OWN_NOISE: Final = 1e-3  # of its unit, of a further quantity: one that all others determine would have no inverse


@dataclass(frozen=True)
class Beside:
    """Quantities that follow from an adjustment. value: (M,); derivative: (M, 14 C); sigma: (M,) their units."""

    value: Array
    derivative: Array
    sigma: Array

    @classmethod
    def nothing(cls, unknowns: int) -> "Beside":
        """None of them."""
        return cls(np.empty(0), np.empty((0, unknowns)), np.empty(0))


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
        return cls.beside(adjusted, problem, Beside.nothing(len(problem.prior.known)))

    @classmethod
    def beside(cls, adjusted: Adjusted, problem: Problem, more: "Beside") -> "PixelInformation":
        """The same with further quantities after the known unknowns, K' + M of them, that no prior claimed."""
        prior = problem.prior
        scale = np.concatenate([np.sqrt(np.diag(prior.claimed)), more.sigma])
        derivative = np.vstack([np.eye(len(prior.known))[prior.known], more.derivative]) / scale[:, None]
        own = np.concatenate([np.zeros(len(prior.covariance)), np.full(len(more.sigma), OWN_NOISE**2)])
        both = np.linalg.inv(derivative @ settled_covariance(adjusted, problem) @ derivative.T + np.diag(own))
        # One that creeps along a weak direction is left before it has settled: it counts where it is bound for.
        further = derivative @ adjusted.factor.solve(adjusted.normal).camera
        away = np.concatenate([prior.deviation(adjusted.estimate.cameras)[prior.known], more.value]) / scale + further
        known = slice(0, len(prior.covariance))
        pixels = both.copy()
        pixels[known, known] -= np.linalg.inv(prior.covariance / np.outer(scale[known], scale[known]))
        believed = _believed(adjusted)
        return cls(scale, *_told(believed * pixels, believed * (both @ away)))

    def about(self, chosen: NDArray[np.bool_], claimed: Array) -> "PixelInformation":
        """What they say of some unknowns (K',), where the others are as claimed (K', K') and independent of these."""
        rest = ~chosen
        others = self.information[np.ix_(rest, rest)]
        others = others + np.linalg.inv(claimed[np.ix_(rest, rest)] / np.outer(self.scale[rest], self.scale[rest]))
        carried = np.linalg.solve(others, self.information[np.ix_(rest, chosen)]).T
        information = self.information[np.ix_(chosen, chosen)] - carried @ self.information[np.ix_(rest, chosen)]
        return PixelInformation(self.scale[chosen], information, self.pull[chosen] - carried @ self.pull[rest])

    def first(self, count: int) -> "PixelInformation":
        """What they say of the first unknowns, where nothing else is known of the others."""
        if count == len(self.scale):
            return self
        of, rest = slice(0, count), slice(count, None)
        carried = np.linalg.solve(self.information[rest, rest], self.information[rest, of]).T
        information = self.information[of, of] - carried @ self.information[rest, of]
        return PixelInformation(self.scale[of], information, self.pull[of] - carried @ self.pull[rest])

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

    def widened(self, parts: Array) -> "PriorTest":
        """The same against priors whose covariance is larger by parts @ parts.T; parts: (K', r)."""
        within = self.frame.T @ parts
        variance, turned = np.linalg.eigh(np.diag(self.variance) + within @ within.T)
        # Wider is never less, though rounding says so beside hundreds of metres (Weyl).
        variance = np.maximum(variance, self.variance.min(initial=np.inf))
        return PriorTest(turned.T @ self.off, variance, self.frame @ turned)

    @property
    def log_likelihood(self) -> float:
        """Of what was seen, if the priors are as good as they say, up to what no wider priors change."""
        return -0.5 * (self.statistic + float(np.log(self.variance).sum()))

    def gains(self, parts: Array) -> Array:
        """(D,) by how much it grows if the priors' covariance is larger by each parts @ parts.T; parts: (D, K', r)."""
        within = self.frame.T @ parts / np.sqrt(self.variance)[:, None]
        across = np.swapaxes(within, 1, 2)
        # 1 + W' W: never singular, though rounding says otherwise where a prior is widened by much.
        values, vectors = np.linalg.eigh(np.eye(parts.shape[2]) + across @ within)
        values = np.maximum(values, 1.0)
        pull = np.swapaxes(vectors, 1, 2) @ (across @ (self.off / np.sqrt(self.variance)))[:, :, None]
        gain: Array = 0.5 * (pull[:, :, 0] ** 2 / values - np.log(values)).sum(axis=1)
        return gain


def _believed(adjusted: Adjusted) -> float:
    """Share of the pixels' information that they can have: rows without noise show only how a file was rounded, and a
    survey held against that is refuted by rounding.
    """
    typical_px = float(np.exp(np.mean(np.log(adjusted.weights.sigma_px))))
    return min(1.0, typical_px / LEAST_ADJUSTED_PX) ** 2


def _told(information: Array, pull: Array) -> tuple[Array, Array]:
    """Information (K, K) and pull (K,) without what is only the rounding of a difference of two large inverses.

    Pixels never know less than nothing: how far below it an eigenvalue lies is how far off the others may be. Left in,
    it would be a certainty wherever a prior is widened beyond it.
    """
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    kept = values > max(0.0, -ROUNDED * float(values.min()))
    told = vectors[:, kept]
    return (told * values[kept]) @ told.T, told @ (told.T @ pull)
