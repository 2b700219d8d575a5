"""What the residuals are weighed with, estimated from the residuals themselves.

Two hazards. Confidence: a detector's error lives for seconds and a lens's for a whole pass, so ten thousand pixels may
hold three hundred independent ones, and weighed by their count they pull the solution off a good survey and report
millimetres. How much they really say is seen from whether parts of the flight agree on the cameras as well as they
claim to. And a circle: a camera of more weight is fitted better, and being fitted better gets more weight. So the
degrees of freedom that its own pull has used up are counted, and a camera with few is held to what all show together.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.flight import FlightEstimate, jerk
from calib.adjustment.noise import SMALLEST_SIGMA_PX, mean_square_px
from calib.adjustment.normal import Factor, Normal, local_covariance
from calib.adjustment.projection import CameraData, Projected, site_time_s, unknowns_of
from calib.geometry.spline import ORDER, THIRD_DIFFERENCE
from edge.common.arrays import Array

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
    least_sigma_px: no camera's is taken to be smaller.
    """

    sigma_px: Array
    interval_s: Array
    correlation_s: float
    jerk_density: float
    least_sigma_px: float = SMALLEST_SIGMA_PX

    def at_least(self, sigma_px: float) -> "Weights":
        """The same with no camera's sigma smaller than that, now and when they are renewed."""
        return replace(self, sigma_px=np.maximum(self.sigma_px, sigma_px), least_sigma_px=sigma_px)

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


def renewed(
    old: Weights, estimate: FlightEstimate, fitted: tuple[Fitted, ...], normal: Normal, factor: Factor
) -> Weights:
    """Weights as the residuals now ask for."""
    local = local_covariance(normal.block)
    variance, freedoms = np.array([_variance(old.weighing_sigma_px[i], part, local) for i, part in enumerate(fitted)]).T
    common = np.exp(np.mean(np.log(variance)))
    own = freedoms / old.correlated
    sigma = np.sqrt((own * variance + COMMON_FREEDOMS * common) / (own + COMMON_FREEDOMS))
    sigma = np.maximum(sigma, old.least_sigma_px)
    lost = float(np.exp(np.mean(np.log(old.sigma_px / sigma)))) ** 2
    shortest = float(old.interval_s.min())
    spread = disagreement(old, estimate, fitted, normal, factor)
    correlation = max(max(old.correlation_s, shortest) * spread * lost, shortest)
    jerk_density = _jerk_density(estimate, local / old.typical_correlated)
    return replace(old, sigma_px=sigma, correlation_s=correlation, jerk_density=jerk_density)


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


def disagreement(
    old: Weights, estimate: FlightEstimate, fitted: tuple[Fitted, ...], normal: Normal, factor: Factor
) -> float:
    """How much more the parts of the flight disagree about the cameras than the weights say they may; 1 is right.

    The scores of blocks of time (the flight eliminated) against the information they claim: the sandwich of Huber
    (1967) and White (1980), clustered in time, reduced to one number by the trace.
    """
    scores = _block_scores(old, estimate, fitted, factor)
    claimed = _claimed(old, estimate, normal, factor)
    if claimed <= 0 or len(scores) < FEWEST_BLOCKS // 2:
        return 1.0
    return float(((scores @ factor.camera_covariance) * scores).sum()) / claimed


def _block_scores(old: Weights, estimate: FlightEstimate, fitted: tuple[Fitted, ...], factor: Factor) -> Array:
    """(blocks, K) pull of each block of time on the cameras, the flight following them."""
    controls, K = len(estimate.control), len(factor.camera_covariance)
    blocks = [_blocks(estimate, index, part) for index, part in enumerate(fitted)]
    count = 1 + max(int(block.max(initial=0)) for block in blocks)
    on_cameras, on_flight = np.zeros((count, K)), np.zeros((count * controls, 3))
    for index, (part, block) in enumerate(zip(fitted, blocks, strict=True)):
        weight = part.kept / (old.weighing_sigma_px[index] * part.data.sigma_px) ** 2
        weighted = part.image.residual * weight[:, None]
        at = unknowns_of(index)
        np.add.at(on_cameras[:, at], block, np.einsum("nij,ni->nj", part.image.by_camera, weighted))
        pull = np.einsum("nij,ni->nj", part.image.by_point, weighted)
        row = (block * controls)[:, None] + part.image.located.controls()
        spread = part.image.located.weights()[:, :, None] * pull[:, None, :]
        for axis in range(3):
            on_flight[:, axis] += np.bincount(row.ravel(), spread[:, :, axis].ravel(), count * controls)
    scores: Array = on_cameras - on_flight.reshape(count, -1) @ factor.carried
    return scores[np.any(scores != 0, axis=1)]


def _blocks(estimate: FlightEstimate, index: int, part: Fitted) -> NDArray[np.int64]:
    """(N,) which block of time each row of a camera falls into."""
    flown = float((estimate.flight.end_s - estimate.flight.start_s).sum())
    length = min(LONGEST_BLOCK_S, flown / FEWEST_BLOCKS)
    since = site_time_s(estimate.cameras[index], part.data) - float(estimate.flight.start_s.min())
    return np.maximum(np.floor(since / length), 0).astype(np.int64)


def _claimed(old: Weights, estimate: FlightEstimate, normal: Normal, factor: Factor) -> float:
    """How many unknowns' worth of information on the cameras the pixels claim: all, less what priors and jerk say."""
    K = len(factor.camera_covariance)
    by_priors = float((factor.camera_covariance * normal.prior).sum())
    carried = factor.carried.reshape(-1, 3 * K)
    four = carried[estimate.flight.piece_controls[:, None] + np.arange(ORDER)]
    third = np.einsum("k,nkd->nd", THIRD_DIFFERENCE, four).reshape(-1, K)
    by_jerk = float(((third @ factor.camera_covariance) * third).sum()) * old.jerk_weight / estimate.flight.spacing_s**5
    freed = normal.slack.T @ factor.carried
    by_jerk -= float(((freed @ factor.camera_covariance) * freed).sum())
    return K - by_priors - by_jerk


def _jerk_density(estimate: FlightEstimate, local: Array) -> float:
    """What the flight's jerk shows plus what its covariance hides (expectation maximisation, Dempster et al. 1977)."""
    h, first = estimate.flight.spacing_s, estimate.flight.piece_controls
    shown = jerk(estimate.flight, estimate.control) ** 2
    hidden = np.einsum("i,niaja,j->na", THIRD_DIFFERENCE, local[first], THIRD_DIFFERENCE) / h**6
    return max(float((shown + hidden).mean()) * h, STIFFEST_JERK)


def steady(old: Weights, new: Weights) -> bool:
    """Whether another round would change nothing that matters."""
    moved = np.abs(np.log(new.weighing_sigma_px / old.weighing_sigma_px))
    return bool(np.all(moved < STEADY)) and abs(np.log(new.jerk_density / old.jerk_density)) < STEADY_JERK
