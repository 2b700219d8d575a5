"""Data association: which detection is which target, by gating and global nearest neighbour over all of them at once.

The hazard is greed. Two objects that cross are each nearest to the other's detection for a moment; giving each
detection to its nearest target swaps them; giving all detections to all targets at the least total cost mostly
does not.
"""

from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from edge.common.arrays import Array

GATE: Final = 16.0  # squared Mahalanobis distance, 2 degrees of freedom: 3 true ones in 10 000 fall outside


def assign(cost: Array, limit: float | Array = GATE) -> list[tuple[int, int]]:
    """Pairs (row, column) of least total cost, each below limit. cost: (N, M); limit: a number, or (N, 1) per row.

    Crouse (2016), by scipy. Leaving a row alone costs it its limit, so a far pairing never pushes out a near one.
    """
    gain = cost - limit
    near = gain < 0
    if not near.any():
        return []
    if near.sum(axis=0).max() <= 1 and near.sum(axis=1).max() <= 1:
        return list(zip(*(index.tolist() for index in np.nonzero(near)), strict=True))
    rows, columns = linear_sum_assignment(np.where(near, gain, 0.0))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if near[r, c]]
