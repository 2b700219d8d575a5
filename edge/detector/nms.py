"""Non-maximum suppression: of several boxes around one object, keep the best.

The hazard is in the corners. A popular routine wants x, y, width, height; handed two corners instead, it takes the
second corner for a size and deletes small objects that stand well apart. So ours takes centres and sizes, as everything
here does, and is tested on two small boxes close together.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

MAX_CANDIDATES: Final = 300  # the work grows with the square; real scenes hold tens


def suppress(centre_px: Array, size_px: Array, score: Array, iou_max: float) -> NDArray[np.intp]:
    """Indices to keep, best first: no two overlap by more than iou_max (intersection over union).

    centre_px, size_px: `(N, 2)`. score: `(N,)`. Only the MAX_CANDIDATES best are looked at.
    """
    order = np.argsort(-score, kind="stable")[:MAX_CANDIDATES]
    low, high = (centre_px - size_px / 2)[order], (centre_px + size_px / 2)[order]
    area = np.prod(size_px[order], axis=1)
    overlap = np.maximum(np.minimum(high[:, None], high) - np.maximum(low[:, None], low), 0.0)
    shared = overlap[..., 0] * overlap[..., 1]
    union = area[:, None] + area - shared
    rivals = shared > iou_max * np.maximum(union, 1e-12)
    left = np.full(order.shape, True)
    for k in range(len(order)):
        if left[k]:
            left[k + 1 :] &= ~rivals[k, k + 1 :]
    kept: NDArray[np.intp] = order[left]
    return kept
