"""Lens files that are wrong: refined under their prior, and named where they are far off."""

import pytest

from calib.simulation.description import LensFault
from tests.calib.flights import site
from tests.synthetic.solving import assert_right, solved


@pytest.mark.parametrize("percent", [3.0, -3.0])
def test_three_per_cent_are_found_and_named(percent: float) -> None:
    focal = 1000.0 * (1 + percent / 100)
    special = {"cam2": {"published_intrinsics": (focal, focal, 960.0, 540.0)}}
    found = solved(site(offsets_s=(0.0,) * 4, special=special))
    report = found.solution.report.cameras[1]
    # The flight determines the focal length to some pixels; a prior of 1 % pulls by 3 sigma of itself.
    assert abs(report.lens_after.intrinsics[0] - 1000.0) < 5 * report.sigma_lens[0]
    assert report.sigma_lens[0] < 8.0
    assert any("focal length of cam2" in str(finding) for finding in found.solution.report.findings)
    # The prior of 1 % is three sigmas wrong and says so in no covariance: twice the usual allowance.
    assert found.rmse_m() < 2 * 4 * found.sigma_m()


def test_errors_as_large_as_the_prior_expects_cost_what_the_covariance_says() -> None:
    for trial in range(3):
        drawn = LensFault(focal=0.01, centre_px=5.0, k1=0.01)
        assert_right(solved(site(offsets_s=(0.0,) * 5, each={"lens_error": drawn}), trial=trial))
