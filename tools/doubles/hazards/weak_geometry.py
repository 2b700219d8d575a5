"""Nothing is wrong but the geometry: short bases and far objects, tripods in a line, an object that goes nowhere.

Whether such a scene can be solved is for the solver to know: a refusal is right, and so is a sigma that admits it.
"""

from typing import Final

import numpy as np

from calib.simulation.description import Metres3, Simulation
from calib.simulation.simulation import simulate
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought
from tools.doubles.hazards.levels import levelled
from tools.doubles.hazards.table import Kind

LONG_LENS: Final = {"intrinsics": (4000.0, 4000.0, 960.0, 540.0)}
TELE: Final = {"intrinsics": (2000.0, 2000.0, 960.0, 540.0)}
SPREAD: Final[Metres3] = (0.12, 0.12, 0.07)  # of the distance: half the box of a far flight


def _far(rng: np.random.Generator, centres: np.ndarray, distance_m: float, duration_s: float) -> Simulation:
    """Cameras at centres (n, 3) that look at a flight to the north."""
    middle = (0.0, distance_m, max(35.0, 0.12 * distance_m))
    half = tuple(share * distance_m for share in SPREAD)
    lens = LONG_LENS if distance_m > 1000.0 else TELE
    thing = scenery.wander(rng, duration_s, middle=middle, half=scenery.metres3(np.array(half)))
    return scenery.scene(rng, scenery.stand(centres, middle, **lens), thing, duration_s=duration_s)


def _bar(rng: np.random.Generator) -> Brought:
    """Three cameras on one bar."""
    bar_m, distances_m = ((1.0, (200.0, 300.0)), (3.0, (200.0, 500.0, 1500.0, 3000.0)), (10.0, (1000.0, 2000.0)))[
        rng.integers(3)
    ]
    distance_m = float(rng.choice(distances_m)) * float(rng.uniform(0.8, 1.25))
    centres = np.array([[-bar_m / 2, 0, 1.5], [bar_m / 2, 0, 1.5], [0, 0.13 * bar_m, 1.5 + 0.5 * bar_m**0.5]])
    centres[:, :2] = centres[:, :2] + rng.normal(0, 0.01 * bar_m, (3, 2))
    return Brought(simulate(_far(rng, centres, distance_m, 70.0)), note=f"{bar_m:g} m, object at {distance_m:.0f} m")


def _base(rng: np.random.Generator) -> Brought:
    """Three or four cameras on a base of 100 to 300 m, the object at two to ten times that."""
    base_m = float(rng.choice([100.0, 200.0, 300.0]))
    distance_m = float(rng.choice([600.0, 1000.0, 2000.0, 3000.0])) * float(rng.uniform(0.9, 1.1))
    count = int(rng.choice([3, 4]))
    across = np.linspace(-base_m / 2, base_m / 2, count)
    back = np.where(np.arange(count) % 2 == 1, -0.4 * base_m, 0.0)
    centres = np.column_stack([across, back, rng.uniform(1, 8, count)])
    return Brought(simulate(_far(rng, centres, distance_m, 90.0)), note=f"{base_m:g} m, object at {distance_m:.0f} m")


def _line(rng: np.random.Generator) -> Brought:
    """Three tripods nearly in a line."""
    off_m = float(rng.choice([0.5, 1.0, 2.0, 3.0]))
    centres = np.array([[-80.0, 0, 1.0], [rng.uniform(-25, 25), off_m, 1.2], [80.0, 0, 1.0]])
    centres[:, 2] += rng.uniform(0, 0.5, 3)
    middle = (0.0, 70.0, 45.0)
    cameras = scenery.stand(centres, middle, survey_sigma_m=(0.03, 0.03, 0.03))
    thing = scenery.wander(rng, 90.0, middle=middle)
    return Brought(simulate(scenery.scene(rng, cameras, thing, duration_s=90.0)), note=f"{off_m:g} m off the line")


def _hover(rng: np.random.Generator) -> Brought:
    """A drone that holds its place."""
    simulation = scenery.usual(rng, int(rng.choice([3, 3, 4])))
    wander_m = float(rng.choice([0.2, 0.4, 1.0, 2.0]))
    middle = scenery.metres3(np.array(scenery.MIDDLE) + rng.uniform(-20, 20, 3))
    thing = scenery.wander(rng, 75.0, middle=middle, half=(wander_m, wander_m, wander_m), step_s=3.0)
    return Brought(simulate(scenery.scene(rng, simulation.camera, thing, duration_s=75.0)), note=f"{wander_m:g} m")


def _fly_past(rng: np.random.Generator) -> Brought:
    """A plane that flies past once, straight and level."""
    distance_m, height_m = float(rng.uniform(200, 600)), float(rng.uniform(80, 200))
    speed_m_s, duration_s = float(rng.uniform(20, 60)), 60.0
    to = rng.uniform(-0.3, 0.3)
    direction = np.array([np.cos(to), np.sin(to), 0.0])
    count = int((duration_s + scenery.BEFORE_S + scenery.AFTER_S) / 2.0) + 2
    times = np.arange(count) * 2.0 - scenery.BEFORE_S - duration_s / 2
    path = np.array([0.0, distance_m, height_m]) + np.outer(times * speed_m_s, direction)
    thing = scenery.through(path, step_s=2.0, name="plane")
    centres = scenery.ring(rng, int(rng.choice([3, 4])), radius_m=80.0)
    cameras = scenery.stand(centres, (0.0, distance_m, height_m), intrinsics=(700.0, 700.0, 960.0, 540.0))
    return Brought(simulate(scenery.scene(rng, cameras, thing, duration_s=duration_s)), note=f"{speed_m_s:.0f} m/s")


def _two_cameras(rng: np.random.Generator) -> Brought:
    """Two cameras 15 m apart that know where up is to a degree or better."""
    middle = (0.0, float(rng.uniform(70, 180)), 40.0)
    half = (0.3 * middle[1], middle[1] - 40.0 if middle[1] < 140.0 else 60.0, 25.0)
    centres = np.array([[-7.5, 0.0, 1.5], [7.5, 0.0, 1.5]]) + rng.normal(0, 0.5, (2, 3)) * (1, 1, 0.2)
    cameras = scenery.stand(centres, middle, intrinsics=(1200.0, 1200.0, 960.0, 540.0))
    thing = scenery.wander(rng, 90.0, middle=middle, half=scenery.metres3(np.array(half)))
    degrees = float(rng.choice([0.1, 0.3, 1.0]))
    simulated = simulate(scenery.scene(rng, cameras, thing, duration_s=90.0))
    note = f"up known to {degrees:g} degrees, {middle[1]:.0f} m away"
    return Brought(levelled(simulated, rng, degrees, degrees), note=note)


WEAK: Final = (
    Kind("bar", _bar),
    Kind("base", _base),
    Kind("line_of_three", _line),
    Kind("hover", _hover),
    Kind("fly_past", _fly_past),
    Kind("two_cameras", _two_cameras),
)
