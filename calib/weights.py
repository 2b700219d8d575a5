"""What the residuals are weighed with, estimated from the residuals themselves.

Two hazards. Confidence: a detector's error lives for seconds and a lens's for a whole pass, so ten thousand pixels may
hold three hundred independent ones, and weighed by their count they pull the solution off a good survey and report
millimetres. How much they really say is seen from whether parts of the flight agree on the cameras as well as they
claim to. And a circle: a camera believed more is fitted better, and being fitted better is believed more. So the
degrees of freedom that its own pull has used up are counted, and a camera with few is held to what all show together.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.flight import Estimate, jerk
from calib.noise import SMALLEST_SIGMA_PX, mean_square_px
from calib.normal import Factor, Normal, local_covariance
from calib.projection import CAMERA_SIZE, CameraData, Projected, site_time_s
from calib.spline import ORDER, THIRD_DIFFERENCE
from edge.lens import Array

COMMON_FREEDOMS: Final = 50.0  # independent residuals the other cameras' example is worth: 10 % of sigma
LEAST_REDUNDANCY: Final = 0.02  # share of its freedoms a camera keeps in any geometry of two
LONGEST_BLOCK_S: Final = 20.0  # parts of the flight whose agreement is tested: a pass before a camera takes as long
FEWEST_BLOCKS: Final = 12  # a short flight is cut finer, or the test would have nothing to compare
STEADY: Final = 0.05  # relative change of every sigma below which the weights are settled
STEADY_JERK: Final = 0.2  # likewise of the jerk density, which matters less
STIFFEST_JERK: Final = 1e-12  # m^2/s^5: a parabola; keeps the prior finite


@dataclass(frozen=True)
class Weights:
    """What residuals and jerk are weighed with.

    sigma_px: (C,) one sigma of a pixel coordinate by camera. interval_s: (C,) between a camera's rows. correlation_s:
    the time in which the pixels of any camera say as much as one. jerk_density: of the flight's jerk, m^2/s^5.
    """

    sigma_px: Array
    interval_s: Array
    correlation_s: float
    jerk_density: float

    @property
    def correlated(self) -> Array:
        """(C,) how many of a camera's rows say as much as one."""
        return np.maximum(1.0, self.correlation_s / self.interval_s)

    @property
    def weighing_sigma_px(self) -> Array:
        """(C,) the sigma to weigh single rows with, so that together they say as much as they know."""
        return np.asarray(self.sigma_px * np.sqrt(self.correlated), float)

    @property
    def jerk_weight(self) -> float:
        """What a squared jerk, integrated over time, costs.

        Divided by the correlated rows as the pixels are: counting every pixel for a fraction must make the poses less
        certain, not the flight stiffer.
        """
        return 1 / (self.jerk_density * self.typical_correlated)

    @property
    def typical_correlated(self) -> float:
        """Geometric mean over the cameras of the rows that say as much as one."""
        return float(np.exp(np.mean(np.log(self.correlated))))


@dataclass(frozen=True)
class Fitted:
    """One camera's part of a fit: its data, its residuals, and the robust share (N,) of each row's weight."""

    data: CameraData
    image: Projected
    kept: Array


def renewed(old: Weights, estimate: Estimate, fitted: tuple[Fitted, ...], normal: Normal, factor: Factor) -> Weights:
    """Weights as the residuals now ask for."""
    local = local_covariance(normal.block)
    variance, freedoms = np.array([_variance(old.weighing_sigma_px[i], part, local) for i, part in enumerate(fitted)]).T
    common = np.exp(np.mean(np.log(variance)))
    own = freedoms / old.correlated
    sigma = np.sqrt((own * variance + COMMON_FREEDOMS * common) / (own + COMMON_FREEDOMS))
    lost = float(np.exp(np.mean(np.log(old.sigma_px / sigma)))) ** 2
    shortest = float(old.interval_s.min())
    spread = disagreement(old, estimate, fitted, factor)
    correlation = max(max(old.correlation_s, shortest) * spread * lost, shortest)
    return Weights(sigma, old.interval_s, correlation, _jerk_density(estimate, local / old.typical_correlated))


def _variance(weighing_sigma_px: float, part: Fitted, local: Array) -> tuple[float, float]:
    """Variance (px^2) that a camera's residuals show, and on how many degrees of freedom that rests."""
    ok = part.image.valid
    redundancy = max(1.0 - _leverage(weighing_sigma_px, part, local), LEAST_REDUNDANCY)
    variance = mean_square_px(part.image.residual[ok], part.data.sigma_px[ok]) / redundancy
    return max(variance, SMALLEST_SIGMA_PX**2), 2 * float(ok.sum()) * redundancy


def _leverage(weighing_sigma_px: float, part: Fitted, local: Array) -> float:
    """Share of a camera's degrees of freedom that the flight's control points have used up."""
    w = part.image.located.weights()
    spread = np.einsum("ni,niajb,nj->nab", w, local[part.image.located.first], w, optimize=True)
    used = np.einsum("nia,nab,nib->n", part.image.by_point, spread, part.image.by_point, optimize=True)
    information = part.kept / (weighing_sigma_px * part.data.sigma_px) ** 2
    return float((used * information).sum() / (2 * max(part.kept.sum(), 1.0)))


def disagreement(weights: Weights, estimate: Estimate, fitted: tuple[Fitted, ...], factor: Factor) -> float:
    """How much more the parts of the flight disagree about the cameras than the weights say they may; 1 is right.

    The scores of blocks of time (the flight eliminated) against the information they claim: the sandwich of Huber
    (1967) and White (1980), clustered in time, reduced to one number by the trace.
    """
    K = len(factor.camera_covariance)
    carried = factor.carried.reshape(-1, 3, K)
    length = _block_length_s(estimate)
    scores: dict[int, Array] = {}
    claimed = 0.0
    for index, part in enumerate(fitted):
        jacobian = _reduced(index, part, carried)
        root = np.sqrt(part.kept) / (weights.weighing_sigma_px[index] * part.data.sigma_px)
        whitened = (jacobian * root[:, None, None]).reshape(-1, K)
        claimed += float(((whitened @ factor.camera_covariance) * whitened).sum())
        pull = np.einsum("nij,ni->nj", jacobian, part.image.residual * (root**2)[:, None])
        block = np.floor(site_time_s(estimate.cameras[index], part.data) / length).astype(int)
        for number in np.unique(block):
            scores[int(number)] = scores.get(int(number), 0.0) + pull[block == number].sum(0)
    if claimed <= 0 or len(scores) < FEWEST_BLOCKS // 2:
        return 1.0
    score = np.array([scores[number] for number in sorted(scores)])
    return float(((score @ factor.camera_covariance) * score).sum()) / claimed


def _block_length_s(estimate: Estimate) -> float:
    flown = float((estimate.flight.end_s - estimate.flight.start_s).sum())
    return min(LONGEST_BLOCK_S, flown / FEWEST_BLOCKS)


def _reduced(index: int, part: Fitted, carried: Array) -> Array:
    """(N, 2, K) derivative by all cameras' unknowns, the flight following them as the normal equations make it."""
    w, four = part.image.located.weights(), part.image.located.controls()
    follows = sum(w[:, i, None, None] * carried[four[:, i]] for i in range(ORDER))
    jacobian: Array = -part.image.by_point @ follows
    jacobian[:, :, CAMERA_SIZE * index : CAMERA_SIZE * (index + 1)] += part.image.by_camera
    return jacobian


def _jerk_density(estimate: Estimate, local: Array) -> float:
    """What the flight's jerk shows plus what its covariance hides (expectation maximisation, Dempster et al. 1977)."""
    h, first = estimate.flight.spacing_s, estimate.flight.piece_controls
    shown = jerk(estimate.flight, estimate.control) ** 2
    hidden = np.einsum("i,niaja,j->na", THIRD_DIFFERENCE, local[first], THIRD_DIFFERENCE) / h**6
    return max(float((shown + hidden).mean()) * h, STIFFEST_JERK)


def steady(old: Weights, new: Weights) -> bool:
    """Whether another round would change nothing that matters."""
    moved = np.abs(np.log(new.weighing_sigma_px / old.weighing_sigma_px))
    return bool(np.all(moved < STEADY)) and abs(np.log(new.jerk_density / old.jerk_density)) < STEADY_JERK
