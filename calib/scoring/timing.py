"""The clock of the truth against the clock of the estimate: a shift and a rate, found from the paths alone.

The hazard is a local minimum: a flight of loops fits itself one loop later almost as well. So every shift at which
enough of the two would overlap is tried on a grid, each with its own best spatial alignment, and only the best few are
refined. A shift at which hardly anything overlaps fits anything; it is not a candidate.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from calib.scoring.alignment import Alignment, fit
from edge.common.arrays import Array

Timing = Literal["none", "shift", "rate"]
TIMINGS: Final[tuple[Timing, ...]] = ("none", "shift", "rate")

GRID_STEP_S: Final = 0.25  # s: 5 m at 20 m/s, well inside the width of any minimum a path of that speed has
COARSE_SAMPLES: Final = 600  # truth rows tried on the grid: enough to tell loops apart, few enough to be quick
CANDIDATES: Final = 6  # minima of the grid that are refined
LEAST_OVERLAP: Final = 0.6  # of the largest overlap any shift has
LARGEST_RATE: Final = 0.02  # a clock that is 2 % off is not a clock
BATCH: Final = 128  # grid shifts tried at once: bounds memory to some tens of megabytes
NOT_ALLOWED: Final = 1e12  # m: cost of what is outside the limits


@dataclass(frozen=True)
class Path:
    """Positions in metres (N, 3) at rising times (N,) in seconds."""

    t_s: Array
    enu: Array

    def at(self, t_s: Array, max_gap_s: float) -> tuple[Array, NDArray[np.bool_]]:
        """Interpolated positions (..., 3) at t_s (...), and which (...) lie in no gap longer than max_gap_s."""
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        start, gap = self.t_s[after - 1], self.t_s[after] - self.t_s[after - 1]
        share = (t_s - start) / np.maximum(gap, 1e-9)
        inside = (share >= 0) & (share <= 1) & (gap <= max_gap_s)
        share = np.clip(share, 0, 1)[..., None]
        return self.enu[after - 1] * (1 - share) + self.enu[after] * share, inside


@dataclass(frozen=True)
class ClockFit:
    """Estimate's time of a truth time t: t + shift_s + rate (t - t_mid_s)."""

    shift_s: float
    rate: float
    t_mid_s: float

    def __call__(self, t_s: Array) -> Array:
        moved: Array = t_s + self.shift_s + self.rate * (t_s - self.t_mid_s)
        return moved


def find_clock(estimate: Path, truth: Path, alignment: Alignment, timing: Timing, max_gap_s: float) -> ClockFit:
    """The clock that brings the estimate nearest to the truth under the given alignment."""
    middle = float(truth.t_s[0] + truth.t_s[-1]) / 2
    if timing == "none":
        return ClockFit(0.0, 0.0, middle)
    half = max(float(truth.t_s[-1] - truth.t_s[0]) / 2, 1e-3)
    starts, least = _grid(estimate, _thinned(truth), alignment, max_gap_s)
    least *= len(truth.t_s) / len(_thinned(truth).t_s)

    def cost(parameters: Array) -> float:
        # The rate is searched as the seconds it makes at the ends, so that both axes have one scale.
        rate = float(parameters[1]) / half if len(parameters) > 1 else 0.0
        if abs(rate) > LARGEST_RATE:
            return NOT_ALLOWED
        t = ClockFit(float(parameters[0]), rate, middle)(truth.t_s)
        distance, overlap = _misfit(estimate, t[None], truth.enu, alignment, max_gap_s, power=2)
        return float(distance[0]) if overlap[0] >= least else NOT_ALLOWED

    size = 2 if timing == "rate" else 1
    best = min((_refined(cost, start, size) for start in starts), key=cost)
    return ClockFit(float(best[0]), float(best[1]) / half if size == 2 else 0.0, middle)


def _refined(cost: Callable[[Array], float], start_s: float, size: int) -> Array:
    """The nearest minimum (Nelder and Mead 1965: the cost has small steps where rows enter and leave the overlap)."""
    first = np.zeros((size + 1, size))
    first[:, 0] = start_s
    for axis in range(size):
        first[axis + 1, axis] += 2 * GRID_STEP_S
    found = minimize(
        cost,
        first[0],
        method="Nelder-Mead",
        options={"initial_simplex": first, "xatol": 1e-5, "fatol": 1e-9, "maxiter": 400},
    )
    return np.asarray(found.x, float)


def _grid(estimate: Path, truth: Path, alignment: Alignment, max_gap_s: float) -> tuple[Array, float]:
    """Shifts (K,) of the best minima of the grid, best first, and the least overlap (rows) that was allowed."""
    lowest, highest = estimate.t_s[0] - truth.t_s[-1], estimate.t_s[-1] - truth.t_s[0]
    shifts = np.arange(lowest, highest + GRID_STEP_S, GRID_STEP_S)
    batches = [shifts[i : i + BATCH] for i in range(0, len(shifts), BATCH)]
    tried = [
        _misfit(estimate, truth.t_s + batch[:, None], truth.enu, alignment, max_gap_s, power=1) for batch in batches
    ]
    cost, overlap = (np.concatenate(column) for column in zip(*tried, strict=True))
    least = LEAST_OVERLAP * overlap.max()
    cost = np.where(overlap >= max(least, 3), cost, np.inf)
    padded = np.pad(cost, 1, constant_values=np.inf)
    minima = np.flatnonzero((cost <= padded[:-2]) & (cost <= padded[2:]) & np.isfinite(cost))
    return shifts[minima[np.argsort(cost[minima], kind="stable")][:CANDIDATES]], float(least)


def _misfit(
    estimate: Path, t_s: Array, truth_enu: Array, alignment: Alignment, max_gap_s: float, *, power: int
) -> tuple[Array, Array]:
    """Mean distance (S,) to the given power after the best motion for each row of t_s (S, N), and the overlaps (S,)."""
    at, inside = estimate.at(t_s, max_gap_s)
    truth = np.broadcast_to(truth_enu, at.shape)
    valid = inside.astype(float)
    distance = np.linalg.norm(fit(alignment, at, truth, valid).apply(at) - truth, axis=2)
    overlap = valid.sum(axis=1)
    return (valid * distance**power).sum(axis=1) / np.maximum(overlap, 1), overlap


def _thinned(path: Path) -> Path:
    """At most about COARSE_SAMPLES rows of a path, evenly taken."""
    every = max(1, len(path.t_s) // COARSE_SAMPLES)
    return Path(path.t_s[::every], path.enu[::every])
