"""How good the pixels are: a scale that outliers do not move, and a loss that does not listen to them."""

from typing import Final

import numpy as np

from edge.common.arrays import Array

CORE: Final = 2.5  # sigma: 95.6 % of good two-dimensional residuals lie within, 95 % efficiency is kept
RAYLEIGH_MEDIAN: Final = 1.1774  # median length of a two-dimensional normal vector of unit sigma
OF_NORMAL: Final = 0.9420  # weighted mean square of normal residuals of unit sigma, under robust_weight squared
SMALLEST_SIGMA_PX: Final = 1e-8  # below it pixels outweigh priors by more than a double holds


def robust_weight(length: Array) -> Array:
    """Weights (N,) of residuals whose length (N,) is in sigmas: 1 in the core, falling as 1/length^2 outside.

    The loss is quadratic with logarithmic tails: a wild residual has no pull, yet keeps a way back.
    """
    weight: Array = np.minimum(1.0, CORE / np.maximum(length, CORE)) ** 2
    return weight


def robust_cost(length: Array) -> Array:
    """Loss (N,) that robust_weight is the weight of."""
    outside = np.maximum(length, CORE)
    cost: Array = np.where(length <= CORE, length**2, CORE**2 * (1 + 2 * np.log(outside / CORE)))
    return cost


def mean_square_px(residual: Array, relative: Array) -> float:
    """Mean square a coordinate of residuals (N, 2) px, outliers notwithstanding.

    relative: (N,) each observation's own sigma as a multiple of the camera's.
    """
    length = np.linalg.norm(residual, axis=1) / relative
    first = float(np.median(length)) / RAYLEIGH_MEDIAN
    # Squared: at weight 1/length^2 every outlier would still count as CORE sigmas of a first guess that it has raised.
    weight = robust_weight(length / max(first, SMALLEST_SIGMA_PX)) ** 2
    square = float((weight * length**2).sum() / (2 * weight.sum()))
    return max(square / OF_NORMAL, SMALLEST_SIGMA_PX**2)
