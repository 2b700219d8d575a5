"""Positions swapped or mistyped: named, with the swap that would fit, and not used."""

import numpy as np
import pytest

from calib.solving.found import Cause
from tests.calib.flights import CAMERAS, site
from tests.synthetic.solving import assert_right, solved


def wrong(**errors_m: tuple[float, float, float]) -> dict[str, dict[str, object]]:
    return {name: {"survey_error_m": error} for name, error in errors_m.items()}


def swapped(one: int, two: int) -> dict[str, dict[str, object]]:
    way = np.subtract(CAMERAS[two], CAMERAS[one])
    return wrong(**{f"cam{one + 1}": tuple(way.tolist()), f"cam{two + 1}": tuple((-way).tolist())})


@pytest.mark.parametrize("pair", [(1, 2), (0, 4)])
def test_a_swap_is_named(pair: tuple[int, int]) -> None:
    found = solved(site(offsets_s=(0.0,) * 5, special=swapped(*pair)))
    one, two = (f"cam{number + 1}" for number in pair)
    assert any(f"{one} and {two} are exchanged" in str(finding) for finding in found.solution.report.findings)
    assert_right(found)


@pytest.mark.parametrize("off_m", [2.0, 150.0])
@pytest.mark.parametrize("trial", [0, 1])
def test_a_mistyped_position_is_named(off_m: float, trial: int) -> None:
    found = solved(site(offsets_s=(0.0,) * 5, special=wrong(cam2=(off_m, 0.0, 0.0))), trial=trial)
    findings = [finding for finding in found.solution.report.findings if finding.cause is Cause.POSITION]
    assert findings
    assert all(finding.cameras == ("cam2",) for finding in findings)
    assert_right(found)


def test_good_positions_are_not_accused() -> None:
    for trial in range(3):
        found = solved(site(offsets_s=(0.0,) * 5), trial=trial)
        assert not any(finding.cause is Cause.POSITION for finding in found.solution.report.findings)
