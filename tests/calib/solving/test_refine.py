"""Refining on a part of many rows first: all of them take part in what is answered, and the answer is the same."""

import numpy as np
import pytest

from calib.adjustment import problem as problems
from calib.adjustment.problem import Problem
from calib.adjustment.projection import CAMERA_SIZE
from calib.adjustment.uncertainty import camera_covariance
from calib.simulation.simulation import simulate
from calib.solving.initial_estimate import from_network
from calib.solving.inputs import Inputs, prepare
from calib.solving.refine import Refined, refine
from tests.calib.flights import site

FLOWN = site(offsets_s=(0.0,) * 4, duration_s=40.0, frame_rate_hz=10.0)


@pytest.fixture(scope="module")
def inputs() -> Inputs:
    """Of a good site."""
    return prepare(simulate(FLOWN).scene)


def refined(inputs: Inputs) -> Refined:
    """It, from where its cameras stand."""
    return refine(inputs, from_network(inputs, simulate(FLOWN).network), 0.5)


def test_a_part_of_the_rows_first_comes_to_what_all_of_them_come_to(
    inputs: Inputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = refined(inputs)
    parts: list[bool] = []
    of_rows = Problem.part.fget
    assert of_rows is not None
    monkeypatch.setattr(problems, "COARSE_ROWS", whole.problem.row_count // 4)
    monkeypatch.setattr(Problem, "part", property(lambda self: parts.append(True) or of_rows(self)))
    found = refined(inputs)
    assert parts
    assert found.problem.row_count == whole.problem.row_count
    sigma = np.sqrt(np.diag(camera_covariance(whole.adjusted, whole.problem))).reshape(-1, CAMERA_SIZE)
    pairs = zip(found.adjusted.estimate.cameras, whole.adjusted.estimate.cameras, sigma, strict=True)
    for one, two, own in pairs:
        # Both stop where a step moves less than a sixth of a sigma.
        assert (np.abs(one.centre_enu - two.centre_enu) < own[3:6] / 3).all()
        assert abs(one.lens.intrinsics[0] - two.lens.intrinsics[0]) < own[9] / 3
    assert found.adjusted.weights.sigma_px == pytest.approx(whole.adjusted.weights.sigma_px, rel=0.1)


def test_a_part_is_each_so_many_th_row_of_a_large_problem_only(inputs: Inputs, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = refined(inputs).problem
    assert problem.part is problem
    monkeypatch.setattr(problems, "COARSE_ROWS", problem.row_count // 2)
    part = problem.part
    assert problem.whole
    assert not part.whole
    assert part.row_count == pytest.approx(problem.row_count / 2, abs=len(problem.data))
