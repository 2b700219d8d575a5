"""A small site and its flight, for the tests of the calibration: three cameras or more about a drone that turns."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from calib.simulation.description import CameraSpec, ObjectSpec, Simulation

SIDE_M = 60.0  # of the square that the flight stays over
CAMERAS = (
    (-70.0, -60.0, 1.0),
    (75.0, -55.0, 2.0),
    (5.0, 85.0, 0.0),
    (-80.0, 60.0, 3.0),
    (80.0, 55.0, 1.0),
    (0.0, -90.0, 2.0),
)


def waypoints(duration_s: float, seed: int, *, height_m: tuple[float, float] = (20.0, 60.0)) -> tuple[Any, ...]:
    """Places 5 s apart, anywhere above the square: a drone at 5 to 10 m/s that changes height as it turns."""
    rng = np.random.default_rng(seed)
    count = int(duration_s // 5) + 2
    low, high = height_m
    places = rng.uniform([-SIDE_M / 2, -SIDE_M / 2, low], [SIDE_M / 2, SIDE_M / 2, high], (count, 3))
    return tuple(tuple(place) for place in places.tolist())


def site(
    *,
    offsets_s: tuple[float, ...] = (0.0, 0.0, 0.0),
    noise_px: float = 0.5,
    rate: float = 0.0,
    duration_s: float = 60.0,
    seed: int = 1,
    frame_rate_hz: float = 15.0,
    height_m: tuple[float, float] = (20.0, 60.0),
    each: Mapping[str, Any] | None = None,
    special: Mapping[str, Mapping[str, Any]] | None = None,
) -> Simulation:
    """A site with as many cameras as offsets. rate: of the second camera's clock.

    each: keys for every camera; special: for single ones, by id.
    """
    cameras = []
    for number, offset_s in enumerate(offsets_s):
        known: dict[str, Any] = {
            "id": f"cam{number + 1}",
            "centre_enu": CAMERAS[number],
            "look_at_enu": (0.0, 0.0, 38.0),
            "frame_rate_hz": frame_rate_hz,
            "phase_s": 0.013 * number,  # cameras do not fire together
            "noise_px": noise_px,
            "clock_offset_s": offset_s,
            "clock_rate": rate if number == 1 else 0.0,
            "survey_error": "gaussian",
        }
        known |= dict(each or {})
        known |= dict((special or {}).get(known["id"], {}))
        cameras.append(CameraSpec(**known))
    flight = ObjectSpec(waypoints_enu=waypoints(duration_s, seed, height_m=height_m), step_s=5.0)
    return Simulation(seed=seed, object=(flight,), camera=tuple(cameras), duration_s=duration_s)
