"""How things fly that are no calm drones: hard turns after a calm stretch, racing, sprints, far passes. As waypoints.

None of these is made with the tracker's own model of motion: accelerations come and go within a fraction of a second,
as pilots and birds make them, and the simulator's spline goes through the points.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from calib.simulation.description import ObjectSpec
from edge.common.arrays import Array

STEP_S: Final = 0.1  # s between waypoints
FINE_S: Final = 0.01  # s of the steps that motion is worked out in
G_M_S2: Final = 9.81
MIDDLE: Final = (0.0, 0.0, 45.0)


def followed(
    wanted: Callable[[float, Array, Array], Array], start: Array, velocity: Array, duration_s: float, lag_s: float
) -> Array:
    """(N, 3) waypoints of what comes to the acceleration it wants (of time, position, velocity) with a lag."""
    position, acceleration = np.array(start, float), np.zeros(3)
    velocity = np.array(velocity, float)
    points, every = [], round(STEP_S / FINE_S)
    for k in range(int((duration_s + 2) / FINE_S)):
        if k % every == 0:
            points.append(position.copy())
        acceleration += (wanted(k * FINE_S, position, velocity) - acceleration) * FINE_S / lag_s
        position = position + velocity * FINE_S
        velocity = velocity + acceleration * FINE_S
    return np.array(points)


def turn_after_calm(rng: np.random.Generator, duration_s: float, turn_g: float) -> Array:
    """Seven calm seconds, then half a second aside and half a second back."""
    heading = rng.uniform(0, 2 * np.pi)
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    aside = np.cross(ahead, [0.0, 0.0, 1.0]) * turn_g * G_M_S2
    at_s = 7.0 + rng.uniform(0, 1)

    def wanted(t_s: float, _position: Array, _velocity: Array) -> Array:
        return aside * (float(at_s < t_s < at_s + 0.5) - float(at_s + 0.5 <= t_s < at_s + 1.0))

    return followed(wanted, np.array(MIDDLE) - ahead * 20 + rng.uniform(-3, 3, 3), ahead * 5, duration_s, 0.05)


def agile(rng: np.random.Generator, duration_s: float, most_g: float) -> Array:
    """Flies from place to place as hard as it can, a new aim each second or so."""
    return _between(rng, duration_s, most_g, (np.array(MIDDLE), np.array([25.0, 25.0, 18.0])))


def calm(rng: np.random.Generator, duration_s: float, home: tuple[float, float, float]) -> Array:
    """Keeps within some metres of its home, and never hurries."""
    return _between(rng, duration_s, 0.4, (np.array(home), np.array([7.0, 7.0, 5.0])))


def _between(rng: np.random.Generator, duration_s: float, most_g: float, room: tuple[Array, Array]) -> Array:
    """From place to place within a room: its middle and half its size."""
    middle, box = room
    aims = [(0.0, middle + rng.uniform(-1, 1, 3) * box)]
    while aims[-1][0] < duration_s + 3:
        aims.append((aims[-1][0] + rng.uniform(0.6, 1.6), middle + rng.uniform(-1, 1, 3) * box))

    def wanted(t_s: float, position: Array, velocity: Array) -> Array:
        aim = next(place for begin_s, place in reversed(aims) if begin_s <= t_s)
        pull = 4 * (aim - position) - 3 * velocity
        return np.asarray(pull * min(1.0, most_g * G_M_S2 / max(float(np.linalg.norm(pull)), 1e-9)))

    return followed(wanted, aims[0][1], np.zeros(3), duration_s, 0.1)


def hover_and_sprint(rng: np.random.Generator, duration_s: float) -> Array:
    """Stands, sprints at 20 m/s for a second, stands again."""
    turns = rng.uniform(0, 2 * np.pi, 50)

    def wanted(t_s: float, position: Array, velocity: Array) -> Array:
        if t_s % 4 < 2.5:
            pull = -velocity / 0.2
        else:
            home = np.arctan2(-position[1], -position[0]) + 0.5 * np.sin(turns[int(t_s // 4)])
            pull = (20 * np.array([np.cos(home), np.sin(home), 0.0]) - velocity) / 0.3
        return np.asarray(pull * min(1.0, 25.0 / max(float(np.linalg.norm(pull)), 1e-9)))

    return followed(wanted, np.array(MIDDLE) + rng.uniform(-8, 8, 3), np.zeros(3), duration_s, 0.1)


def circle(rng: np.random.Generator, duration_s: float, speed_m_s: float, turn_g: float) -> Array:
    """A circle flown from the first frame on: there is no calm stretch to begin from."""
    radius_m = speed_m_s**2 / (turn_g * G_M_S2)
    angle = speed_m_s / radius_m * _steps_s(duration_s) + rng.uniform(0, 2 * np.pi)
    flat = np.column_stack([np.cos(angle), np.sin(angle), 0.15 * np.sin(2 * angle)])
    return np.add(np.array(MIDDLE) + rng.uniform(-5, 5, 3), radius_m * flat, dtype=np.float64)


def passing(rng: np.random.Generator, duration_s: float, away_m: float, speed_m_s: float) -> Array:
    """A straight pass, away to the north, a third of that high."""
    middle = np.array([rng.uniform(-0.05, 0.05) * away_m, 0.95 * away_m, 0.3 * away_m])
    after_s = _steps_s(duration_s) - duration_s / 2
    return np.asarray(middle + after_s[:, None] * np.array([speed_m_s, 0.0, 0.0]))


def _steps_s(duration_s: float) -> Array:
    return np.asarray(np.arange(int((duration_s + 2) / STEP_S)) * STEP_S, np.float64)


def flown(points: Array, name: str = "object") -> ObjectSpec:
    """An object that flies through waypoints (N, 3), from a second before the scene on."""
    waypoints = tuple((float(x), float(y), float(z)) for x, y, z in points)
    return ObjectSpec(name=name, waypoints_enu=waypoints, step_s=STEP_S, start_s=-1.0)
