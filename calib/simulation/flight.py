"""Where an object is at any instant: a cubic spline, exact, so that no truth is ever interpolated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from calib.simulation.description import ObjectSpec
from edge.common.arrays import Array
from edge.common.errors import ConfigError


@dataclass(frozen=True)
class ObjectFlight:
    """One object's path. times_s: (K,) of the waypoints, seconds since the scene's start."""

    object: ObjectSpec
    times_s: Array
    spline: CubicSpline

    def position_enu(self, t_s: ArrayLike) -> Array:
        """(N, 3) metres at t_s (N,); NaN before the first and after the last waypoint."""
        position: Array = self.spline(np.asarray(t_s, float), extrapolate=False)
        return position

    def velocity_enu(self, t_s: ArrayLike) -> Array:
        """(N, 3) metres a second at t_s (N,); NaN outside the flight."""
        velocity: Array = self.spline(np.asarray(t_s, float), nu=1, extrapolate=False)
        return velocity


def flight(thing: ObjectSpec) -> ObjectFlight:
    """The flight through an object's waypoints. Raises ConfigError if it has none, or not one time for each."""
    count = len(thing.waypoints_enu)
    if count < 2:
        raise ConfigError("flies nowhere", where=f"object {thing.name}", action="give `waypoints_enu` or `roam`")
    times: Array = np.array(thing.times_s or np.arange(count) * thing.step_s, float)
    if len(times) != count or np.any(np.diff(times) <= 0):
        raise ConfigError(
            f"{len(times)} times for {count} waypoints, or times that do not rise",
            where=f"object {thing.name}, times_s",
            action="give one rising time a waypoint, or step_s",
        )
    times = times + thing.start_s
    # Not-a-knot needs four points; a line or parabola through two or three is what "natural" gives.
    boundary = thing.boundary if count >= 4 or thing.boundary == "clamped" else "natural"
    return ObjectFlight(thing, times, CubicSpline(times, np.asarray(thing.waypoints_enu, float), bc_type=boundary))
