"""A flight that nobody planned: accelerations at random that last for a while, and a pull back to where it lives.

The hazard is a tracker that has only ever seen smooth paths through waypoints, which its motion model fits better than
anything alive. Accelerations are first-order Gauss-Markov, as in Singer (1970); a weak spring and some drag keep the
thing in view for as long as the scene lasts. Waypoints of the path are close enough (KNOT_S) for a spline through them
to be the path itself, so that truth is exact here as well.
"""

from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter, lfiltic

from calib.simulation.description import ObjectSpec
from calib.simulation.flight import ObjectFlight
from edge.common.arrays import Array
from edge.common.errors import ConfigError

STEP_S: Final = 0.01  # of the integration: a hundredth of the shortest correlation time of anything alive
KNOT_S: Final = 0.1  # between the spline's knots: an eighth of a bird's correlation time
SPRING_S2: Final = (0.06, 0.06, 0.12)  # 1/s^2 towards home, east, north, up: swings of 26 s, and of 18 s in height
DRAG_S: Final = 0.15  # 1/s: a speed is forgotten within 7 s
AFTER_S: Final = 2.0  # it flies on when the scene has ended: the last frames' late rows still see it


def roam(thing: ObjectSpec, duration_s: float, rng: np.random.Generator) -> ObjectFlight:
    """One flight from `start_s` to a little after the scene's end. Raises ConfigError if it has waypoints as well."""
    if thing.roam is None or thing.waypoints_enu:
        raise ConfigError(
            "roams and has waypoints", where=f"object {thing.name}", action="give `roam` or `waypoints_enu`"
        )
    steps = int(np.ceil((duration_s + AFTER_S - thing.start_s) / STEP_S)) + 1
    if steps < 2:
        raise ConfigError("starts after the scene's end", where=f"object {thing.name}", action="give a lower start_s")
    start_m = rng.uniform(-1.0, 1.0, 3) * thing.roam.spread_m
    speed_m_s = rng.normal(0.0, 1.0, 3) * thing.roam.speed_m_s
    driven = _accelerations(steps, thing.roam.sigma_m_s2, thing.roam.tau_s, rng)
    off_m = np.column_stack([_sprung(driven[:, k], start_m[k], speed_m_s[k], SPRING_S2[k]) for k in range(3)])
    every = round(KNOT_S / STEP_S)
    times_s = np.asarray(thing.start_s + np.arange(0, steps, every) * STEP_S, float)
    return ObjectFlight(thing, times_s, CubicSpline(times_s, off_m[::every] + np.asarray(thing.roam.home_enu, float)))


def _accelerations(steps: int, sigma_m_s2: float, tau_s: float, rng: np.random.Generator) -> Array:
    """(steps, 3) m/s^2, first-order Gauss-Markov, from rest."""
    kept = np.exp(-STEP_S / tau_s)
    drawn = rng.normal(0.0, 1.0, (steps, 3)) * sigma_m_s2 * np.sqrt(1 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], drawn, axis=0))


def _sprung(driven_m_s2: Array, start_m: float, speed_m_s: float, spring_s2: float) -> Array:
    """(steps,) metres from home along one axis: x'' = driven - spring x - DRAG x', by symplectic Euler steps."""
    h = STEP_S
    recursion = [1.0, -(2 - DRAG_S * h - spring_s2 * h**2), 1 - DRAG_S * h]
    before = lfiltic([h**2], recursion, y=[start_m, start_m - h * speed_m_s])
    return np.asarray(lfilter([h**2], recursion, driven_m_s2, zi=before)[0])
