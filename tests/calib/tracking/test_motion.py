"""The motion model: there and back, in two steps as in one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from calib.tracking.motion import Singer


@given(dt=st.floats(0.001, 1.0), tau=st.floats(1.0, 5.0))
def test_motion_goes_there_and_back_and_in_two_steps_as_in_one(dt: float, tau: float) -> None:
    model = Singer(tau, 3.0)
    there, back = model.transition(np.array([dt])), model.transition(np.array([-dt]))
    np.testing.assert_allclose(there @ back, np.eye(9)[None], atol=1e-6 * np.exp(dt / tau))
    half = model.transition(np.array([dt / 2]))
    noise = model.noise(np.array([dt / 2]))
    twice = half @ noise @ half.transpose(0, 2, 1) + noise
    # Four Gauss-Legendre nodes are exact for the polynomial part; the exponential leaves (dt / tau)^8.
    np.testing.assert_allclose(twice, model.noise(np.array([dt])), rtol=1e-3, atol=1e-9)
