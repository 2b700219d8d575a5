"""Two cameras on a short base: a flight livelier to and fro than across is not pulled together along their sight.

Jerk taken to be alike in all directions told more of the distance than the cameras did: the drone came out 55 m nearer,
the survey was contradicted, and both lenses were blamed.
"""

import pytest

from calib.solving.solve import solve
from tools.doubles.hazards.kinds import draw
from tools.doubles.hazards.verdict import score

HONEST = 2.0  # squared error over squared sigma that is asked of each


@pytest.mark.parametrize("number", [0, 4, 8])
def test_sigma_covers_how_far_it_is(number: int) -> None:
    brought = draw("two_cameras", "choose", 1, number)
    solution = solve(brought.simulated.scene, start=brought.simulated.network)
    found = score(brought, solution)
    assert found.beyond == 0.0
    assert found.nees < HONEST
    assert solution.report.strain is not None
    assert not solution.report.strain.doubts, "nothing is wrong in it"
