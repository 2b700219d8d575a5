"""What one camera alone goes on seeing keeps its number, and nothing else."""

import numpy as np

from calib.tracking.estimates import TargetEstimate, TargetState
from calib.tracking.lone import LoneTargets


def farewell(track: int) -> TargetEstimate:
    return TargetEstimate(track, TargetState.LOST, 0, np.zeros(3), np.zeros(3), np.eye(6), (), 0.0, 1.0)


def test_the_number_goes_to_the_target_found_from_the_same_object_of_the_same_camera() -> None:
    lone = LoneTargets()
    lone.keep(7, ("north", 3), 10.0, farewell(7))
    assert 7 in lone
    assert lone.heir({("north", 4), ("east", 3)}) is None
    assert lone.heir({("east", 9), ("north", 3)}) == 7
    assert 7 not in lone
    assert lone.heir({("north", 3)}) is None, "given once"


def test_it_lasts_while_its_camera_sees_it_and_is_lost_for_good_after() -> None:
    lone = LoneTargets()
    lone.keep(7, ("north", 3), 10.0, farewell(7))
    lone.note("north", np.array([1, 3]), 14.0)
    lone.note("east", np.array([3]), 20.0)
    assert lone.end(12.0) == []
    lone.shift(-4.0)
    (ended,) = lone.end(10.5)
    assert (ended.track, len(lone)) == (7, 0)
