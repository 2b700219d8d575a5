"""Fault diagnosis from residuals: noise is none, a knock beyond what is expected is one."""

import numpy as np
import pytest

from calib.guarding.diagnosis import Residual, diagnose
from tools.doubles.flight import T0_UNIX_NS


def test_noise_alone_is_no_fault_and_a_knock_beyond_the_expected_always() -> None:
    rng = np.random.default_rng(1)

    def residuals(off: tuple[float, float], expected_px: float) -> list[Residual]:
        velocity = rng.normal(0, 30, (20, 2))
        return [
            Residual(T0_UNIX_NS + k * 10**8, rng.normal(off, 1.0), velocity[k], 1.0, expected_px) for k in range(20)
        ]

    now = T0_UNIX_NS + 2 * 10**9
    assert diagnose(residuals((0, 0), 0.5), now) is None
    assert diagnose(residuals((5, 3), 2.0), now) is None, "that much is expected"
    fault = diagnose(residuals((8, 3), 0.5), now)
    assert fault is not None
    assert fault.knock_px == pytest.approx(np.hypot(8, 3), abs=1.0)
    assert diagnose(residuals((8, 3), 0.5)[:4], now) is None, "four residuals are not enough"
