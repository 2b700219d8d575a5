"""Two targets that are one object: the younger ends.

The hazard is the object under two numbers. After a loss both the old target, coasting, and a new one may settle on the
same detections, and whoever counts aircraft counts two.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.tracking.filterbank import FilterBank
from calib.tracking.track_scores import TrackScores

TWIN_SIGMA2: Final = 12.0  # squared normalised distance within which two targets are one object, 3 degrees of freedom
NEAR_M: Final = 10.0  # farther apart they are not looked at


def twins(bank: FilterBank, scores: TrackScores) -> NDArray[np.bool_]:
    """(N,) targets that have become the same object as an older one."""
    twin = np.zeros(len(bank), bool)
    for k in range(1, len(bank)):
        apart = bank.state[:k, :3] - bank.state[k, :3]
        apart += bank.state[:k, 3:6] * (bank.t_s[k] - bank.t_s[:k])[:, None]
        near = np.linalg.norm(apart, axis=1) < NEAR_M
        for j in np.nonzero(near & ~twin[:k])[0]:
            P = bank.covariance[j, :6, :6] + bank.covariance[k, :6, :6]
            both = np.concatenate([apart[j], bank.state[j, 3:6] - bank.state[k, 3:6]])
            twin[k] |= bool(both @ np.linalg.solve(P, both) < TWIN_SIGMA2 and scores.rivals(int(j), k))
    return twin
