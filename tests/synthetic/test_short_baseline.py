"""Cameras close together: depth and frame hang on centimetres of survey, and the covariance has to say so."""

import pytest

from tests.calib.flights import site
from tests.synthetic.solving import assert_right, solved


def close(side_m: float) -> dict[str, dict[str, object]]:
    places = [(-side_m / 2, -70.0, 1.0), (side_m / 2, -70.0, 1.0), (0.0, -70.0 - side_m / 2, side_m / 2)]
    return {f"cam{k + 1}": {"centre_enu": place} for k, place in enumerate(places)}


@pytest.mark.parametrize("trial", [0, 1, 2])
def test_twenty_metres(trial: int) -> None:
    found = solved(site(special=close(20.0), noise_px=0.3), trial=trial)
    # 2 cm over 20 m are 1 mrad, 10 cm at 100 m; the lenses' 1 % adds metres of depth, which it must own up to.
    assert 0.2 < found.sigma_m() < 6.0
    assert_right(found)


def test_uncertainty_grows_as_the_baseline_shrinks() -> None:
    sigma = [solved(site(special=close(side_m), noise_px=0.3)).sigma_m() for side_m in (40.0, 10.0)]
    assert sigma[1] > 1.5 * sigma[0]
