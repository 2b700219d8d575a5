"""Several objects at once: rows that are right or wrong together, because each is one track taken for one other.

The hazard is the draw at random. Nobody knows which track of one camera shows what which of another does; of four
objects three combinations in four are wrong, and five rows of all are right together once in a thousand draws. But a
track is of one object throughout: drawn from one combination at a time, all rows are right, or none is of use.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

COMBINATION_DRAWS: Final = 60  # of rows that are all right or all wrong, clutter and noise aside
MOST_COMBINATIONS: Final = 16  # that are tried: four objects in the air, seen as four tracks by each of two cameras


def of_one_combination(combination: NDArray[np.int64] | None) -> Iterator[NDArray[np.int64]]:
    """The rows of each combination (N,), those of most rows first; of none if there is but one."""
    if combination is None:
        return
    labels, count = np.unique(combination, return_counts=True)
    if len(labels) > 1:
        for label in labels[np.argsort(-count, kind="stable")][:MOST_COMBINATIONS]:
            yield np.flatnonzero(combination == label)
