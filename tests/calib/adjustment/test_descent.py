"""Downhill in a valley: where the object is far, a descent ends where its own equations ask for no further step."""

import numpy as np
import pytest

from calib.adjustment.descent import descend
from calib.adjustment.normal import factorise
from calib.adjustment.problem import Point
from calib.solving.beginnings import from_survey
from calib.solving.common_time import on_one_time
from calib.solving.initial_estimate import begun
from calib.solving.inputs import prepare
from calib.solving.refine import first_weights, problem_of
from tools.doubles.hazards.kinds import draw

STEPS = 40
OPEN = 0.1  # squared sigmas of the cameras: a third of a sigma that is left to go


def beginning(number: int) -> Point:
    """Near the end of what cameras 100 to 300 m apart begin with that look at an object 600 m away and more."""
    timed = on_one_time(prepare(draw("base", "choose", 1, number).simulated.scene), local=False, near_s=3.0)
    cameras = from_survey(timed.inputs, timed.clocks)[0]
    problem, estimate = problem_of(timed.inputs, begun(timed.inputs, cameras, timed.clocks), 0.5)
    weights = first_weights(problem, estimate)
    near = descend(Point.at(problem, estimate, weights), STEPS).point.estimate
    finer = type(weights)(weights.sigma_px / 8, weights.interval_s, 0.0, weights.jerk_density / 100)
    return Point.at(problem, near, finer)


@pytest.mark.parametrize("number", [1, 2])
def test_it_settles_where_no_step_is_left(number: int) -> None:
    descent = descend(beginning(number), STEPS)
    assert descent.settled
    assert descent.cost == descent.point.cost()
    normal = descent.point.normal()
    assert factorise(normal).solve(normal).camera_squared < OPEN


def test_what_had_its_steps_has_not_settled() -> None:
    start = beginning(1)
    one, two = descend(start, 1), descend(start, 2)
    assert not one.settled
    assert start.cost() > one.cost > two.cost


def test_half_the_second_derivative_along_a_step_is_what_the_step_lacks() -> None:
    """To the third order: halved, a bent step misses an eighth of what it missed."""
    point = beginning(1)
    normal = point.normal()
    whole = factorise(normal, 1e-2, slack=False).solve(normal)

    def missed(share: float) -> float:
        step = whole.scaled(share)
        ahead = point.moved(step.scaled(0.1))
        images = zip(point.projected, ahead.projected, point.moved(step).projected, strict=True)
        total = 0.0
        for index, (here, near, there) in enumerate(images):
            own = step.camera[14 * index : 14 * index + 14]
            moved_m = np.einsum("nk,nkd->nd", here.located.weights(), step.control[here.located.controls()])
            straight = np.einsum("nij,nj->ni", here.by_point, moved_m) + here.by_camera @ own
            half = ((near.residual - here.residual) / 0.1 - straight) / 0.1
            total += float(np.abs(there.residual - here.residual - straight - half)[here.valid].max())
        return total

    assert missed(0.1) < missed(0.2) / 4
