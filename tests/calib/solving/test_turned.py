"""A tripod that is knocked in flight: named with its time, and half of its rows spared, where three others agree."""

import numpy as np
import pytest

from calib.solving.found import Cause
from calib.solving.solve import solve
from calib.solving.turned import TURN_INSTANTS
from tools.doubles.hazards.brought import Brought
from tools.doubles.hazards.kinds import draw
from tools.doubles.hazards.verdict import score


def knocked(kind: str, number: int, cameras: int) -> Brought:
    """The scene of a kind with that number among those of so many cameras and more."""
    drawn = (draw(kind, "choose", 11, each) for each in range(100))
    return [one for one in drawn if len(one.cameras) >= cameras][number]


@pytest.mark.parametrize("number", range(2))
@pytest.mark.parametrize("kind", ["knock_0.5", "knock_3", "moved_2m"])
def test_it_is_named_and_nobody_else_is_turned(kind: str, number: int) -> None:
    brought = knocked(kind, number, 4)
    solution = solve(brought.simulated.scene)
    told = [found for found in solution.report.findings if found.cause is Cause.POSE]
    assert [found.cameras for found in told] == [(brought.note.split()[0],)]
    assert not score(brought, solution).confidently_wrong


def test_its_time_is_told_to_the_step_that_is_looked_with() -> None:
    brought = knocked("knock_3", 0, 4)
    at_s = float(brought.note.split(" at ")[1].split()[0])
    scene = brought.simulated.scene
    first_ns = min(int(own.t_unix_ns[0]) for own in scene.observations.values())
    last_ns = max(int(own.t_unix_ns[-1]) for own in scene.observations.values())
    (told,) = [str(found) for found in solve(scene).report.findings if found.cause is Cause.POSE]
    said = np.datetime64(told.split("at about ")[1].split(" UTC")[0].replace(" ", "T"))
    off_s = (said - np.datetime64(first_ns, "ns")) / np.timedelta64(1, "s") - at_s
    assert abs(off_s) <= 1.0 + (last_ns - first_ns) * 1e-9 / (TURN_INSTANTS + 1)  # and the second that is told


@pytest.mark.parametrize("number", range(2))
def test_of_three_cameras_nobody_can_tell_which(number: int) -> None:
    brought = next(
        b for b in (draw("knock_3", "choose", 11, n) for n in range(number * 20, 100)) if len(b.cameras) == 3
    )
    found = solve(brought.simulated.scene).report.findings
    assert all(one.cause is not Cause.POSE for one in found)


@pytest.mark.parametrize("kind", ["healthy_square", "healthy_drift", "healthy_two_drones", "healthy_lenses_1pc"])
def test_who_stands_still_is_not_said_to_have_turned(kind: str) -> None:
    for number in range(2):
        scene = draw(kind, "choose", 11, number).simulated.scene
        assert all(one.cause is not Cause.POSE for one in solve(scene).report.findings)
