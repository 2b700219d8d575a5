"""Where a trajectory begins and ends: not before two cameras had seen the object, nor after."""

import numpy as np
import pytest

from calib.solving.solve import SolveOptions, solve
from tools.doubles.hazards.kinds import draw
from tools.doubles.hazards.verdict import score


@pytest.mark.parametrize("number", [0, 2])
def test_birds_are_not_flown_on_after_they_were_seen(number: int) -> None:
    """Dozens that are seen for 0.3 to 4 s: a tenth of a second at each end, made up, is one position in thirty."""
    brought = draw("healthy_birds", "choose", 0, number)
    solution = solve(brought.simulated.scene, SolveOptions())
    assert len(np.unique(solution.trajectory.track)) > 30
    assert score(brought, solution).beyond < 1e-3
