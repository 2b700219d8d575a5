"""Whether an estimate's own sigma is true: its errors in units of what it states, all together and by circumstance.

The hazard is the mean that hides. A sigma may be twice too small where two cameras see the object and twice too large
where six do, and be right on average. So errors are also counted by number of cameras and by time.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

CHI2_3_999: Final = 16.27  # one true NEES of position in a thousand is larger
PART_S: Final = 60.0  # s of flight that are told together, or a multiple of it
MOST_PARTS: Final = 12
SMALLEST_VARIANCE_M2: Final = 1e-12  # of a row that states nothing smaller than a micrometre


@dataclass(frozen=True)
class Stated:
    """What an estimate says of each of its rows (N,): covariance (N, 3, 3), m2, in its own frame; how many cameras."""

    covariance: Array
    cameras: NDArray[np.int64]

    def chosen(self, rows: NDArray[np.intp]) -> "Stated":
        """That of some rows."""
        return Stated(self.covariance[rows], self.cameras[rows])


@dataclass(frozen=True)
class Consistency:
    """Errors against stated sigma over some rows.

    nees: mean of the normalised squared error of position, 3 if sigma is true (Bar-Shalom, Li and Kirubarajan 2001,
    5.4); error_over_sigma: the root of a third of it; beyond: share outside the 99.9 % ellipsoid; sigma_m: root of the
    median of the stated variances' sum.
    """

    over: str
    rows: int
    rmse_m: float
    sigma_m: float
    nees: float
    error_over_sigma: float
    beyond: float


def consistency(error: Array, stated: Stated, t_s: Array) -> tuple[Consistency, ...]:
    """Of all rows, of those that each number of cameras saw, and of each stretch of time.

    error: (N, 3) m, in the frame of the stated covariances; t_s: (N,) s, rising.
    """
    variance = np.trace(stated.covariance, axis1=1, axis2=2)
    whole = stated.covariance + SMALLEST_VARIANCE_M2 * np.eye(3)
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(whole, error[:, :, None])[:, :, 0])
    squared_m2 = np.sum(error**2, axis=1)
    groups = [("all", np.ones(len(error), bool))]
    groups += [(f"{count} cameras", stated.cameras == count) for count in np.unique(stated.cameras).tolist()]
    groups += _stretches(t_s)
    return tuple(
        _of(name, squared_m2[rows], variance[rows], nees[rows]) for name, rows in groups if np.count_nonzero(rows)
    )


def _of(over: str, squared_m2: Array, variance_m2: Array, nees: Array) -> Consistency:
    return Consistency(
        over=over,
        rows=len(nees),
        rmse_m=float(np.sqrt(squared_m2.mean())),
        sigma_m=float(np.sqrt(np.median(variance_m2))),
        nees=float(nees.mean()),
        error_over_sigma=float(np.sqrt(nees.mean() / 3)),
        beyond=float(np.mean(nees > CHI2_3_999)),
    )


def _stretches(t_s: Array) -> list[tuple[str, NDArray[np.bool_]]]:
    """Stretches of a minute, or of several where that would be many, named by where they begin and end."""
    since_s = t_s - t_s[0]
    part_s = PART_S * np.ceil((since_s[-1] + 1e-9) / PART_S / MOST_PARTS)
    which = (since_s // part_s).astype(int)
    return [(f"{k * part_s:.0f} to {(k + 1) * part_s:.0f} s", which == k) for k in range(int(which[-1]) + 1)]
