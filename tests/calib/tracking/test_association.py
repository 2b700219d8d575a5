"""Data association: the best of all assignments."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.tracking.association import assign


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 5), columns=st.integers(1, 5))
def test_assignment_is_the_best_of_all(seed: int, rows: int, columns: int) -> None:
    cost = np.random.default_rng(seed).uniform(0, 30, (rows, columns))
    gain = np.minimum(cost - 16.0, 0.0)
    found = assign(cost)
    wide = np.zeros((rows, columns + rows))
    wide[:, :columns] = gain
    best = min(sum(wide[r, c] for r, c in enumerate(order)) for order in permutations(range(columns + rows), rows))
    assert sum(gain[r, c] for r, c in found) == pytest.approx(best)
    assert all(cost[r, c] < 16.0 for r, c in found)
