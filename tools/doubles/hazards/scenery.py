"""Where tripods stand and what flies, drawn at random: the usual site is three or four cameras and one drone.

Default: cameras about 100 m from a drone that wanders in 120 x 120 x 50 m, 10 Hz, 0.7 px noise, survey 2/2/4 cm, clock
bound 5 ms. Lens files are off by half a per cent as measured ones are; what a kind is about comes on top.
"""

from collections.abc import Mapping
from typing import Any, Final

import msgspec
import numpy as np

from calib.simulation.description import CameraSpec, LensFault, Metres3, ObjectSpec, Simulation
from edge.common.arrays import Array

MIDDLE: Final[Metres3] = (0.0, 0.0, 40.0)  # of the flight, metres
HALF_BOX: Final[Metres3] = (60.0, 60.0, 25.0)
DURATIONS_S: Final = (60.0, 75.0, 90.0)
BEFORE_S: Final = 5.0  # waypoints begin before the scene and go on after it, for clocks that are off
AFTER_S: Final = 15.0
USUAL: Final[dict[str, Any]] = {
    "frame_rate_hz": 10.0,
    "noise_px": 0.7,
    "survey_error": "gaussian",
    "clock_bound_s": 0.005,
    "lens_error": LensFault(focal=0.005, centre_px=4.0, k1=0.003),
}


def metres3(vector: Array) -> Metres3:
    """An array (3,) as a description has it."""
    east, north, up = np.asarray(vector, float).tolist()
    return (east, north, up)


def name_of(number: int) -> str:
    """Of the camera with that number."""
    return f"cam{number}"


def usual_count(rng: np.random.Generator, least: int = 3) -> int:
    """How many cameras a site has: mostly three or four, six at most."""
    counts = [count for count in (3, 3, 3, 4, 4, 4, 5, 6) if count >= least]
    return int(rng.choice(counts))


def ring(rng: np.random.Generator, count: int, radius_m: float = 115.0, jitter: float = 0.2) -> Array:
    """(count, 3) tripods around the flight, each off its place by a share of the radius, on uneven ground."""
    bearing = 2 * np.pi * (np.arange(count) + rng.uniform(-jitter, jitter, count)) / count + rng.uniform(0, 2 * np.pi)
    radius = radius_m * (1 + rng.uniform(-jitter, jitter, count))
    return np.column_stack([radius * np.sin(bearing), radius * np.cos(bearing), rng.uniform(0.5, 4.0, count)])


def arc(rng: np.random.Generator, count: int, radius_m: float = 115.0) -> Array:
    """(count, 3) tripods along a bent road on one side of the flight, over half of the horizon."""
    bearing = np.linspace(-np.pi / 2, np.pi / 2, count) + rng.uniform(-0.15, 0.15, count) + rng.uniform(0, 2 * np.pi)
    radius = radius_m * rng.uniform(0.85, 1.15, count)
    return np.column_stack([radius * np.sin(bearing), radius * np.cos(bearing), rng.uniform(0.5, 4.0, count)])


def polygon(rng: np.random.Generator, count: int, radius_m: float = 100.0, off_m: float = 2.0) -> Array:
    """(count, 3) tripods paced out as a regular figure, as a guide recommends, off by a step or two."""
    bearing = 2 * np.pi * np.arange(count) / count + rng.uniform(0, 2 * np.pi)
    centres = np.column_stack([radius_m * np.sin(bearing), radius_m * np.cos(bearing), np.full(count, 1.5)])
    return np.asarray(centres + rng.normal(0, 1, (count, 3)) * (off_m, off_m, 0.3))


def wander(
    rng: np.random.Generator,
    duration_s: float,
    *,
    middle: Metres3 = MIDDLE,
    half: Metres3 = HALF_BOX,
    step_s: float = 5.0,
    name: str = "drone",
) -> ObjectSpec:
    """A drone through waypoints anywhere in a box."""
    count = int((duration_s + BEFORE_S + AFTER_S) / step_s) + 2
    places = np.array(middle) + rng.uniform(-1.0, 1.0, (count, 3)) * half
    return through(places, step_s, name)


def through(path_enu: Array, step_s: float, name: str = "drone") -> ObjectSpec:
    """Something that flies through places (K, 3), the first BEFORE_S before the scene begins."""
    places = tuple(map(metres3, path_enu))
    return ObjectSpec(name=name, waypoints_enu=places, step_s=step_s, start_s=-BEFORE_S)


def stand(centres: Array, look_at: Metres3 = MIDDLE, **keys: Any) -> tuple[CameraSpec, ...]:
    """Cameras at centres (n, 3), all looking one way; keys: instead of the usual ones."""
    return tuple(
        CameraSpec(
            id=name_of(k), centre_enu=metres3(centre), look_at_enu=look_at, phase_s=0.011 * k, **{**USUAL, **keys}
        )
        for k, centre in enumerate(centres)
    )


def scene(
    rng: np.random.Generator,
    cameras: tuple[CameraSpec, ...],
    *things: ObjectSpec,
    duration_s: float,
) -> Simulation:
    """All of it, with errors of its own."""
    return Simulation(
        name="hazard", seed=int(rng.integers(2**31)), object=things, camera=cameras, duration_s=duration_s
    )


def usual(rng: np.random.Generator, count: int | None = None, **keys: Any) -> Simulation:
    """A usual site: tripods around a drone that wanders. keys: of every camera."""
    duration_s = float(rng.choice(DURATIONS_S))
    centres = ring(rng, count or usual_count(rng))
    return scene(rng, stand(centres, **keys), wander(rng, duration_s), duration_s=duration_s)


def changed(simulation: Simulation, keys: Mapping[str, Mapping[str, Any]]) -> Simulation:
    """The scene with some keys of some cameras changed."""
    cameras = tuple(msgspec.structs.replace(camera, **keys.get(camera.id, {})) for camera in simulation.camera)
    return msgspec.structs.replace(simulation, camera=cameras)


def some(rng: np.random.Generator, simulation: Simulation, count: int = 1) -> tuple[str, ...]:
    """Some of its cameras, by name."""
    names = [camera.id for camera in simulation.camera]
    return tuple(sorted(rng.choice(names, count, replace=False).tolist()))
