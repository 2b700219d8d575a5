"""What a site is told although one of its cameras cannot be used."""

from calib.solving.solve import solve
from tools.doubles.hazards.kinds import draw
from tools.doubles.hazards.verdict import score


def test_a_camera_that_is_tried_again_does_not_cost_the_others() -> None:
    """Of a hovering object a camera's pose is found in a wrong place, from which nothing can be determined."""
    brought = draw("healthy_hovering", "choose", 5, 0)
    solution = solve(brought.simulated.scene)
    assert len(solution.network.cameras) >= 4
    assert not score(brought, solution).confidently_wrong
