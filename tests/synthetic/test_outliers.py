"""Three rows of ten anywhere in the image, in every camera: the flight is found all the same."""

import pytest

from tests.calib.flights import site
from tests.synthetic.solving import assert_right, solved


@pytest.mark.parametrize("count", [3, 4])
@pytest.mark.parametrize("trial", [0, 1])
def test_thirty_per_cent(count: int, trial: int) -> None:
    found = solved(site(offsets_s=(0.0,) * count, each={"outlier": 0.3}), trial=trial)
    assert len(found.names) == count
    assert_right(found)
    for camera in found.solution.report.cameras:
        # The noise of the good rows is 0.5 px; what outliers add to its estimate is bounded (test_noise.py).
        assert camera.sigma_px < 0.7


@pytest.mark.parametrize("trial", [0, 1])
def test_clutter_with_numbers_of_its_own(trial: int) -> None:
    found = solved(site(offsets_s=(0.0,) * 3, each={"clutter_per_frame": 0.5, "dropout": 0.1}), trial=trial)
    assert len(found.names) == 3
    assert_right(found)
