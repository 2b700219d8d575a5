"""A trajectory's errors against the truth, under a named alignment.

The usual figures are easy to mistake for each other: "MAE" is published as the mean of the 1-norm and as the mean of
the 2-norm of the error vector, which differ by up to 1.7. Both are given, by name. And small errors are half of the
answer: whether the estimate's own sigma is true is told beside them, where it states one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.scoring.alignment import Alignment, fit
from calib.scoring.consistency import Consistency, Stated, consistency
from calib.scoring.timing import Path, Timing, find_clock
from edge.common.arrays import Array
from edge.common.errors import SkyfixError

LONGEST_BRIDGED_S = 0.5  # s: an estimate is interpolated over no longer gap; a target at 20 m/s turns visibly in more
FEWEST_MATCHED = 4  # below it every alignment fits anything


@dataclass(frozen=True)
class Evaluation:
    """Errors in metres after alignment. Per-axis tuples are east, north, up of the truth's frame.

    matched, truth_rows: truth rows compared, and how many lie in the estimate's time span. shift_s, rate: what was
    found of the clocks. yaw_deg, scale, moved_m: what the alignment took away. mae_1_norm_m and mae_2_norm_m: the mean
    of |x| + |y| + |z| and of the distance. consistency: errors against the estimate's own sigma, if it states one.
    """

    alignment: str
    timing: str
    matched: int
    truth_rows: int
    rmse_m: float
    median_m: float
    maximum_m: float
    mae_1_norm_m: float
    mae_2_norm_m: float
    r_squared: float
    rmse_axis_m: tuple[float, float, float]
    mae_axis_m: tuple[float, float, float]
    r_squared_axis: tuple[float, float, float]
    shift_s: float
    rate: float
    yaw_deg: float
    tilt_deg: float
    scale: float
    moved_m: tuple[float, float, float]
    consistency: tuple[Consistency, ...]


def evaluate(
    estimate: Path,
    truth: Path,
    alignment: Alignment = "yaw",
    timing: Timing = "rate",
    max_gap_s: float = LONGEST_BRIDGED_S,
    *,
    stated: Stated | None = None,
) -> Evaluation:
    """Score an estimate against the truth. stated: what the estimate says of its rows, one each.

    The clock is searched under the same alignment that is then reported. Raises SkyfixError if fewer than four truth
    rows meet the estimate.
    """
    if min(len(estimate.t_s), len(truth.t_s)) < FEWEST_MATCHED:
        raise _too_few(min(len(estimate.t_s), len(truth.t_s)))
    estimate, truth = _about_zero(estimate, truth)
    clock = find_clock(estimate, truth, alignment, timing, max_gap_s)
    t_s = clock(truth.t_s)
    at, inside = estimate.at(t_s, max_gap_s)
    if inside.sum() < FEWEST_MATCHED:
        raise _too_few(int(inside.sum()))
    kept, true = at[inside][None], truth.enu[inside][None]
    motion = fit(alignment, kept, true, np.ones(kept.shape[:2]))
    in_span = (t_s >= estimate.t_s[0]) & (t_s <= estimate.t_s[-1])
    R = motion.R_truth_estimate[0]
    aligned = motion.apply(kept)[0]
    parts: tuple[Consistency, ...] = ()
    if stated is not None:
        own_error = (aligned - true[0]) @ R / motion.scale[0]
        parts = consistency(own_error, stated.chosen(_nearest(estimate.t_s, t_s[inside])), t_s[inside])
    return Evaluation(
        alignment=alignment,
        timing=timing,
        matched=int(inside.sum()),
        truth_rows=int(in_span.sum()),
        **_figures(aligned, true[0]),
        shift_s=clock.shift_s,
        rate=clock.rate,
        yaw_deg=float(np.degrees(np.arctan2(R[1, 0], R[0, 0]))),
        tilt_deg=float(np.degrees(np.arccos(np.clip(R[2, 2], -1, 1)))),
        scale=float(motion.scale[0]),
        moved_m=_three((aligned - kept[0]).mean(axis=0)),
        consistency=parts,
    )


def _nearest(times_s: Array, t_s: Array) -> NDArray[np.intp]:
    """(N,) which of some rising times is nearest to each of t_s (N,)."""
    after = np.clip(np.searchsorted(times_s, t_s), 1, len(times_s) - 1)
    before_is_nearer = t_s - times_s[after - 1] < times_s[after] - t_s
    return np.asarray(after - before_is_nearer, np.intp)


def _too_few(rows: int) -> SkyfixError:
    return SkyfixError(
        f"only {rows} rows of the truth meet the estimate",
        where="evaluation",
        action="check that both are of one flight, and with timing 'none' that both have one clock",
    )


def _about_zero(estimate: Path, truth: Path) -> tuple[Path, Path]:
    """Both on times that start near 0 if they start apart: seconds since 1970 leave a double 0.2 us only."""
    base = np.floor(truth.t_s[0])
    return Path(estimate.t_s - base, estimate.enu), Path(truth.t_s - base, truth.enu)


def _figures(estimate: Array, truth: Array) -> dict[str, Any]:
    """Everything that is a function of the errors alone. Both (N, 3)."""
    error = estimate - truth
    distance = np.linalg.norm(error, axis=1)
    squares, spread = (error**2).sum(axis=0), ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
    return {
        "rmse_m": float(np.sqrt(np.mean(distance**2))),
        "median_m": float(np.median(distance)),
        "maximum_m": float(distance.max()),
        "mae_1_norm_m": float(np.abs(error).sum(axis=1).mean()),
        "mae_2_norm_m": float(distance.mean()),
        "r_squared": float(1 - squares.sum() / max(spread.sum(), 1e-12)),
        "rmse_axis_m": _three(np.sqrt((error**2).mean(axis=0))),
        "mae_axis_m": _three(np.abs(error).mean(axis=0)),
        "r_squared_axis": _three(1 - squares / np.maximum(spread, 1e-12)),
    }


def _three(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
