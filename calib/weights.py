"""What the residuals are weighed with, estimated from the residuals themselves.

The hazard is a circle: a camera believed more is fitted better, and being fitted better is believed more, until one
camera is taken as exact and the others carry all the error. Two things break it. The degrees of freedom that a camera's
own pull has used up are counted (expectation maximisation, Dempster et al. 1977), and what remains is weighed by how
much it really says: a camera whose independent residuals are few is held to what all cameras show together.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.flight import Estimate, jerk
from calib.noise import SMALLEST_SIGMA_PX, PixelNoise, correlated_samples, mean_square_px
from calib.normal import Normal, local_covariance
from calib.projection import CameraData, Projected
from calib.spline import THIRD_DIFFERENCE
from edge.lens import Array

COMMON_FREEDOMS: Final = 50.0  # independent residuals the other cameras' example is worth: 10 % of sigma
LEAST_REDUNDANCY: Final = 0.02  # share of its freedoms a camera keeps in any geometry of two
STEADY: Final = 0.03  # relative change of every sigma below which the weights are settled
STEADY_JERK: Final = 0.15  # likewise of the jerk density, which matters less
STIFFEST_JERK: Final = 1e-12  # m^2/s^5: a parabola; keeps the prior finite


@dataclass(frozen=True)
class Weights:
    """Each camera's noise, and the power density of the flight's jerk, m^2/s^5."""

    noise: tuple[PixelNoise, ...]
    jerk_density: float

    @property
    def jerk_weight(self) -> float:
        """What a squared jerk, integrated over time, costs.

        Divided by the correlated samples as the pixels are: counting every pixel for a fraction must make the poses
        less certain, not the flight stiffer.
        """
        return 1 / (self.jerk_density * self.correlated)

    @property
    def correlated(self) -> float:
        """Typical count of correlated samples over the cameras."""
        return float(np.exp(np.mean([np.log(noise.correlated) for noise in self.noise])))


def renewed(
    old: Weights,
    estimate: Estimate,
    normal: Normal,
    *,
    data: tuple[CameraData, ...],
    projected: tuple[Projected, ...],
    kept: tuple[Array, ...],
) -> Weights:
    """Weights as the residuals now ask for. kept: per camera (N,) the robust share of each observation's weight."""
    local = local_covariance(normal.block)
    shown = [
        _shown(noise, seen, image, share, local)
        for noise, seen, image, share in zip(old.noise, data, projected, kept, strict=True)
    ]
    common = float(np.exp(np.mean([np.log(one.variance) for one in shown])))
    correlation_s = float(np.exp(np.mean([np.log(one.correlation_s) for one in shown])))
    noise = tuple(one.noise(common, correlation_s) for one in shown)
    return Weights(noise, _jerk_density(estimate, local / old.correlated))


@dataclass(frozen=True)
class _Shown:
    """What one camera's residuals show: variance px^2, how long they correlate, how many rows it has how often."""

    variance: float
    correlation_s: float
    interval_s: float
    rows: float

    def noise(self, common_variance: float, correlation_s: float) -> PixelNoise:
        """The camera's noise, held to what all cameras show by as much as its own residuals leave open."""
        correlated = max(1.0, correlation_s / self.interval_s)
        own = self.rows / correlated
        variance = (own * self.variance + COMMON_FREEDOMS * common_variance) / (own + COMMON_FREEDOMS)
        return PixelNoise(float(np.sqrt(variance)), correlated)


def _shown(noise: PixelNoise, data: CameraData, image: Projected, kept: Array, local: Array) -> _Shown:
    ok = image.valid
    redundancy = max(1.0 - _leverage(noise, data, image, kept, local), LEAST_REDUNDANCY)
    residual, relative = image.residual[ok], data.sigma_px[ok]
    interval = float(np.median(np.diff(data.t_s)))
    correlated = correlated_samples(data.t_s[ok], residual / relative[:, None])
    variance = max(mean_square_px(residual, relative) / redundancy, SMALLEST_SIGMA_PX**2)
    return _Shown(variance, correlated * interval, interval, 2 * len(residual) * redundancy)


def _leverage(noise: PixelNoise, data: CameraData, image: Projected, kept: Array, local: Array) -> float:
    """Share of a camera's degrees of freedom that the flight's control points have used up."""
    w = image.located.weights()
    spread = np.einsum("ni,niajb,nj->nab", w, local[image.located.first], w, optimize=True)
    used = np.einsum("nia,nab,nib->n", image.by_point, spread, image.by_point, optimize=True)
    information = kept / (noise.weighing_sigma_px * data.sigma_px) ** 2
    return float((used * information).sum() / (2 * max(kept.sum(), 1.0)))


def _jerk_density(estimate: Estimate, local: Array) -> float:
    """What the flight's jerk shows plus what its covariance hides."""
    h, first = estimate.flight.spacing_s, estimate.flight.piece_controls
    shown = jerk(estimate.flight, estimate.control) ** 2
    hidden = np.einsum("i,niaja,j->na", THIRD_DIFFERENCE, local[first], THIRD_DIFFERENCE) / h**6
    return max(float((shown + hidden).mean()) * h, STIFFEST_JERK)


def steady(old: Weights, new: Weights) -> bool:
    """Whether another round would change nothing that matters."""
    before = np.array([noise.weighing_sigma_px for noise in old.noise])
    after = np.array([noise.weighing_sigma_px for noise in new.noise])
    return (
        bool(np.all(np.abs(np.log(after / before)) < STEADY))
        and abs(np.log(new.jerk_density / old.jerk_density)) < STEADY_JERK
    )
