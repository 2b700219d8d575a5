"""A drawn flight without any noise: what a newcomer makes first, and no reason to refuse.

Its residuals are the rounding of a file. Weighed with what they show, pixels outweighed the flight's smoothness by more
than a double holds, and a flight with every direction in it was told to leave one undetermined.
"""

import json
from pathlib import Path

import pytest

from calib.station.app import main
from calib.station.report.grade import OUTLIER_SHARE
from tests.calib.flights import site
from tests.synthetic.solving import solved

SURVEY_M = 0.05  # what the surveyed positions are good for: all that is left to be wrong


@pytest.mark.parametrize("count", [3, 4])
@pytest.mark.parametrize("trial", [0, 1, 2])
def test_it_is_solved(count: int, trial: int) -> None:
    found = solved(site(offsets_s=(0.0,) * count, noise_px=0.0), trial=trial)
    assert len(found.names) == count
    assert found.rmse_m() < 2 * SURVEY_M
    # What a spline is off by at a turn stands out from rounding, and is no reason to look at a detector.
    assert 1 - min(camera.inlier_share for camera in found.solution.report.cameras) < OUTLIER_SHARE[1]


def test_no_doubt_is_weighed_from_rounding() -> None:
    found = solved(site(offsets_s=(0.0,) * 3, noise_px=0.0, seed=118, duration_s=66.0), trial=18)
    assert found.rmse_m() < 2 * SURVEY_M


def test_the_scene_that_comes_with_the_program(tmp_path: Path) -> None:
    assert main(["simulate", "demo", "--output", str(tmp_path / "demo")]) == 0
    assert main(["solve", str(tmp_path / "demo"), "--output", str(tmp_path / "out")]) == 0
    grade = json.loads((tmp_path / "out" / "report.json").read_text())["grade"]
    assert grade in "ABC", "nothing is wrong in it, and no lens file is to be blamed"
