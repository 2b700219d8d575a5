"""A flight at one height: every pair of cameras has a twin, a second pose that fits as well. A third camera decides."""

import pytest

from tests.calib.flights import site
from tests.synthetic.solving import assert_right, solved


@pytest.mark.parametrize("count", [3, 4])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_twin_is_not_taken(count: int, seed: int) -> None:
    found = solved(site(offsets_s=(0.0,) * count, height_m=(39.9, 40.1), seed=seed))
    assert found.names == [f"cam{k + 1}" for k in range(count)]
    # The twin is tens of degrees away; 1 % of focal length, 10 px of principal point, is 10 mrad.
    assert max(found.turned_rad(name) for name in found.names) < 0.04
    assert_right(found)
