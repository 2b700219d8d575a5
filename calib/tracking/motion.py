"""The motion model and its process noise: how an object may move between two looks at it, after Singer (1970).

The hazard is coasting. With white jerk an acceleration once estimated lasts for ever, and two seconds without a
measurement throw a turning target off the map; here acceleration dies away with a time constant, so that a coasting
target slows its turn and its uncertainty grows as fast as a real pilot can prove us wrong, not faster.

State, per target: position, velocity, acceleration, (9,) in ENU metres and seconds.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from edge.common.arrays import Array

STATE: Final = 9
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)  # exact to 1e-9 of the integral for steps below tau


@dataclass(frozen=True)
class Singer:
    """tau_s: how long a manoeuvre lasts. sigma_m_s2: how hard, one sigma an axis."""

    tau_s: float = 1.5
    sigma_m_s2: float = 4.0

    def transition(self, dt_s: Array) -> Array:
        """(N, 9, 9) matrices that take states over dt_s (N,); negative steps go back in time."""
        dt_s = np.asarray(dt_s, float)
        F = np.zeros((len(dt_s), 3, 3))
        F[:, 0, 0] = F[:, 1, 1] = 1.0
        F[:, 0, 1] = dt_s
        F[:, :, 2] = self._response(dt_s)
        return _per_axis(F)

    def noise(self, dt_s: Array) -> Array:
        """(N, 9, 9) covariances of the process noise within dt_s (N,), also for steps back in time."""
        dt_s = np.asarray(dt_s, float)
        at = self._response(dt_s[:, None] * ((NODES + 1) / 2))
        density = 2 * self.sigma_m_s2**2 / self.tau_s  # of the white noise that keeps the acceleration at sigma
        weights = density / 2 * np.abs(dt_s)[:, None] * WEIGHTS
        return _per_axis(np.matmul((at * weights[..., None]).transpose(0, 2, 1), at))

    def _response(self, s: Array) -> Array:
        """(..., 3) position, velocity and acceleration s seconds after a unit acceleration."""
        decay = np.exp(-s / self.tau_s)
        velocity = self.tau_s * (1.0 - decay)
        response = np.empty((*np.shape(s), 3))
        response[..., 0], response[..., 1], response[..., 2] = self.tau_s * (s - velocity), velocity, decay
        return response


def _per_axis(blocks: Array) -> Array:
    """(N, 9, 9) from (N, 3, 3): the same for east, north and up."""
    return (blocks[:, :, None, :, None] * np.eye(3)[None, None, :, None, :]).reshape(-1, STATE, STATE)
