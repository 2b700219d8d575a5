"""How good the pixels are: their scale, their outliers, and how many of them are really independent.

The hazard is confidence. A detector's error lives for seconds: ten thousand pixels of one camera may hold only three
hundred independent ones, and weighed by their count they pull the solution off a good survey and report millimetres.
So each camera's variance is that of its own residuals, multiplied by their correlation time in samples.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from edge.lens import Array

CORE: Final = 2.5  # sigma: 95.6 % of good two-dimensional residuals lie within, 95 % efficiency is kept
RAYLEIGH_MEDIAN: Final = 1.1774  # median length of a two-dimensional normal vector of unit sigma
FEWEST_ROWS: Final = 20  # fewer say nothing of their correlation
SMALLEST_SIGMA_PX: Final = 1e-11  # keeps a noiseless simulation from dividing by zero; rounding is 1e-13 px
CORRELATION_WINDOW_S: Final = 25.0  # correlations beyond it are bias, which the survey and the other cameras answer


@dataclass(frozen=True)
class PixelNoise:
    """One camera's residuals. sigma_px: one sigma a coordinate; correlated: samples that make one independent one."""

    sigma_px: float
    correlated: float

    @property
    def weighing_sigma_px(self) -> float:
        """The sigma to weigh single observations with, so that together they say as much as they know."""
        return self.sigma_px * float(np.sqrt(self.correlated))


def robust_weight(length: Array) -> Array:
    """Weights (N,) of residuals whose length (N,) is in sigmas: 1 in the core, falling as 1/length^2 outside.

    The loss is quadratic with logarithmic tails: a wild residual has no pull, yet keeps a way back.
    """
    weight: Array = np.minimum(1.0, CORE / np.maximum(length, CORE)) ** 2
    return weight


def robust_cost(length: Array) -> Array:
    """Loss (N,) whose derivative robust_weight is the weight of."""
    outside = np.maximum(length, CORE)
    cost: Array = np.where(length <= CORE, length**2, CORE**2 * (1 + 2 * np.log(outside / CORE)))
    return cost


def mean_square_px(residual: Array, relative: Array) -> float:
    """Mean square a coordinate of residuals (N, 2) px, outliers notwithstanding.

    relative: (N,) each observation's own sigma as a multiple of the camera's.
    """
    length = np.linalg.norm(residual, axis=1) / relative
    first = float(np.median(length)) / RAYLEIGH_MEDIAN
    weight = robust_weight(length / max(first, SMALLEST_SIGMA_PX))
    return max(float((weight * length**2).sum() / (2 * weight.sum())), SMALLEST_SIGMA_PX**2)


def correlated_samples(t_s: Array, residual: Array) -> float:
    """How many successive residuals (N, 2) at times (N,) say as much as one: the integrated autocorrelation.

    Sum of the lagged products under a triangular window (Bartlett 1946), which unlike a cut-off does not jump when a
    residual changes a little. At least 1.
    """
    if len(t_s) < FEWEST_ROWS:
        return 1.0
    length = np.linalg.norm(residual, axis=1, keepdims=True)
    clipped = residual * np.minimum(1.0, CORE * np.median(length) / RAYLEIGH_MEDIAN / np.maximum(length, 1e-300))
    clipped = clipped - clipped.mean(0)
    power = float((clipped**2).mean())
    step = float(np.median(np.diff(t_s)))
    if not power > 0 or not step > 0:
        return 1.0
    total, window = 1.0, min(len(t_s) // 4, int(CORRELATION_WINDOW_S / step))
    for lag in range(1, window):
        together = t_s[lag:] - t_s[:-lag] < 1.5 * lag * step  # not across gaps
        if together.any():
            product = float((clipped[lag:] * clipped[:-lag])[together].mean())
            total += 2 * (1 - lag / window) * product / power
    return max(total, 1.0)
