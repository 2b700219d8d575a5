"""On whose word alone a calibration stands."""

import numpy as np
import pytest

from calib.simulation.simulation import simulate
from calib.solving.solve import solve
from tests.calib.flights import site

SQUARE = ((-75.0, -60.0, 1.0), (75.0, -55.0, 2.0), (80.0, 55.0, 1.0), (-80.0, 60.0, 3.0))


def rests_on(centres: tuple[tuple[float, float, float], ...], seed: int = 1) -> tuple[str, ...]:
    special = {f"cam{k + 1}": {"centre_enu": centre} for k, centre in enumerate(centres)}
    described = site(offsets_s=(0.0,) * len(centres), special=special, seed=seed, duration_s=40.0, frame_rate_hz=10.0)
    return solve(simulate(described).scene).network.rests_on


@pytest.mark.parametrize("seed", [1, 2])
def test_of_three_nobody_checks_anybody(seed: int) -> None:
    """A height of one that is off tilts the world, and the triangle keeps its shape."""
    assert rests_on(SQUARE[:3], seed) == ("cam1", "cam2", "cam3")


@pytest.mark.parametrize("seed", [1, 2])
def test_of_six_about_a_field_each_is_checked_by_five(seed: int) -> None:
    """Of four it depends on how long was flown: 3.7 times the sigma without one of them, and 2.2 a minute later."""
    angles = np.radians(60.0 * np.arange(6))
    assert rests_on(tuple((95 * np.cos(a), 95 * np.sin(a), k % 3) for k, a in enumerate(angles)), seed) == ()


def test_three_in_a_line_hang_on_the_one_beside_it() -> None:
    """A site leans about its line by what the fourth claims of its height."""
    assert rests_on(((-80.0, -60.0, 1.0), (0.0, -60.0, 1.0), (80.0, -60.0, 1.0), (0.0, 70.0, 1.0))) == ("cam4",)


def test_two_side_by_side_check_each_other_and_nobody_the_others() -> None:
    assert rests_on((*SQUARE[:3], (-72.0, -60.0, 1.0))) == ("cam2", "cam3")
