"""Non-maximum suppression: of several boxes around one object, keep the best.

The hazard is in the corners. A popular routine wants x, y, width, height; handed two corners instead, it takes the
second corner for a size and deletes small objects that stand well apart. So ours takes centres and sizes, as everything
here does, and is tested on two small boxes close together.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.detector.detections import Array

MAX_CANDIDATES: Final = 300  # the work grows with the square; real scenes hold tens


def suppress(
    centre_px: Array, size_px: Array, score: Array, iou_max: float, group: NDArray[np.intp] | None = None
) -> NDArray[np.intp]:
    """Indices to keep, best first: no two of one group overlap by more than iou_max (intersection over union).

    centre_px, size_px: `(N, 2)`. score: `(N,)`. group: `(N,)` class of each, None if all compete.
    Only the MAX_CANDIDATES best are looked at.
    """
    order = np.argsort(-score, kind="stable")[:MAX_CANDIDATES]
    low, high = centre_px - size_px / 2, centre_px + size_px / 2
    area = np.prod(size_px, axis=1)
    keep: list[int] = []
    while order.size:
        best, rest = order[0], order[1:]
        keep.append(int(best))
        overlap = np.minimum(high[best], high[rest]) - np.maximum(low[best], low[rest])
        shared = np.prod(np.maximum(overlap, 0.0), axis=1)
        union = area[best] + area[rest] - shared
        same = np.full(rest.shape, True) if group is None else group[rest] == group[best]
        order = rest[~(same & (shared > iou_max * np.maximum(union, 1e-12)))]
    return np.array(keep, dtype=np.intp)
