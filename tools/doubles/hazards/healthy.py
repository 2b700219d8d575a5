"""Sites with nothing wrong in them, each in its own way: what the solver must not refuse, and nobody to be named."""

from functools import partial
from typing import Any, Final

import msgspec
import numpy as np

from calib.simulation.description import LensFault
from calib.simulation.simulation import simulate
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought
from tools.doubles.hazards.levels import levelled
from tools.doubles.hazards.survey_faults import GEOID_M
from tools.doubles.hazards.table import Kind

LEVEL_SIGMA_DEG: Final = 0.5  # a bubble on the tripod's head


def _usual(rng: np.random.Generator, count: int | None = None, **keys: Any) -> Brought:
    return Brought(simulate(scenery.usual(rng, count, **keys)), healthy=True)


def _laid_out(rng: np.random.Generator, layout: Any, count: int | None = None, **keys: Any) -> Brought:
    duration_s = float(rng.choice(scenery.DURATIONS_S))
    cameras = scenery.stand(layout(rng, count or scenery.usual_count(rng)), **keys)
    thing = scenery.wander(rng, duration_s)
    return Brought(simulate(scenery.scene(rng, cameras, thing, duration_s=duration_s)), healthy=True)


def _short(rng: np.random.Generator) -> Brought:
    simulation = scenery.usual(rng)
    return Brought(simulate(msgspec.structs.replace(simulation, duration_s=25.0)), healthy=True)


def _long(rng: np.random.Generator) -> Brought:
    """Three minutes at 5 Hz."""
    simulation = scenery.usual(rng, int(rng.choice([3, 4])), frame_rate_hz=5.0)
    thing = scenery.wander(rng, 180.0)
    return Brought(simulate(msgspec.structs.replace(simulation, object=(thing,), duration_s=180.0)), healthy=True)


def _wide(rng: np.random.Generator) -> Brought:
    """A site of half a kilometre, on a hillside, with lenses to match."""
    centres = scenery.ring(rng, scenery.usual_count(rng), radius_m=260.0)
    centres[:, 2] += 0.15 * centres[:, 0]
    middle, half = (0.0, 0.0, 110.0), (100.0, 100.0, 50.0)
    cameras = scenery.stand(centres, middle, intrinsics=(1400.0, 1400.0, 960.0, 540.0))
    thing = scenery.wander(rng, 75.0, middle=middle, half=half)
    return Brought(simulate(scenery.scene(rng, cameras, thing, duration_s=75.0)), healthy=True)


def _orbit(rng: np.random.Generator) -> Brought:
    """A point of interest circled, with clocks that are vouched for."""
    t = np.arange(-scenery.BEFORE_S, 75.0 + scenery.AFTER_S, 1.0)
    angle = 2 * np.pi * t / float(rng.uniform(18, 30))
    path = np.column_stack([40 * np.cos(angle), 40 * np.sin(angle), 45 + 6 * np.sin(1.7 * angle)])
    cameras = scenery.stand(scenery.ring(rng, scenery.usual_count(rng)))
    thing = scenery.through(path, step_s=1.0)
    return Brought(simulate(scenery.scene(rng, cameras, thing, duration_s=75.0)), healthy=True)


def _zooms(rng: np.random.Generator) -> Brought:
    """Focal lengths from 700 to 1800 px, the long ones farther away."""
    simulation = scenery.usual(rng, scenery.usual_count(rng, 4))
    keys = {}
    for camera in simulation.camera:
        focal = float(rng.uniform(700, 1800))
        away = np.array(camera.centre_enu) * (focal / 1000.0, focal / 1000.0, 1.0)
        keys[camera.id] = {"intrinsics": (focal, focal, 960.0, 540.0), "centre_enu": scenery.metres3(away)}
    return Brought(simulate(scenery.changed(simulation, keys)), healthy=True)


def _sparse(rng: np.random.Generator) -> Brought:
    return _usual(rng, frame_rate_hz=5.0, dropout=0.4, dropout_length_s=0.5, outlier=0.03)


def _rolling_shutter(rng: np.random.Generator) -> Brought:
    published = bool(rng.random() < 0.5)
    return _usual(rng, readout_s=float(rng.uniform(0.005, 0.03)), publish_readout=published)


def _cliff(rng: np.random.Generator, *, level: bool) -> Brought:
    """Upright cameras on the edge of a cliff, everything flown below them.

    Pictures whose v is counted upwards make the same world of a flight above: unless one camera says where up is (its
    level), a refusal is right.
    """
    centres = scenery.arc(rng, scenery.usual_count(rng)) + np.array([0.0, 0.0, float(rng.uniform(80, 110))])
    cameras = scenery.stand(centres)
    thing = scenery.wander(rng, 75.0)
    simulated = simulate(scenery.scene(rng, cameras, thing, duration_s=75.0))
    if not level:
        return Brought(simulated)
    one = (scenery.name_of(int(rng.integers(len(cameras)))),)
    return Brought(levelled(simulated, rng, LEVEL_SIGMA_DEG, LEVEL_SIGMA_DEG, one), healthy=True)


def _ceiling(rng: np.random.Generator) -> Brought:
    """Cameras that hang upside down from a roof and say so: up_cam."""
    centres = scenery.ring(rng, scenery.usual_count(rng), radius_m=28.0)
    centres[:, 2] = rng.uniform(18.0, 21.0, len(centres))
    middle, half = (0.0, 0.0, 6.0), (12.0, 12.0, 5.0)
    cameras = scenery.stand(centres, middle, roll_deg=180.0, intrinsics=(900.0, 900.0, 960.0, 540.0))
    thing = scenery.wander(rng, 75.0, middle=middle, half=half)
    simulated = simulate(scenery.scene(rng, cameras, thing, duration_s=75.0))
    return Brought(levelled(simulated, rng, LEVEL_SIGMA_DEG, LEVEL_SIGMA_DEG), healthy=True)


def _all_low(rng: np.random.Generator) -> Brought:
    """All heights above the sea: one world, 47.6 m lower, in which nothing can be told to be wrong."""
    simulation = scenery.usual(rng)
    lat, lon, height = simulation.origin
    return Brought(simulate(msgspec.structs.replace(simulation, origin=(lat, lon, height - GEOID_M))), healthy=True)


def _two_drones(rng: np.random.Generator) -> Brought:
    simulation = scenery.usual(rng)
    second = scenery.wander(rng, simulation.duration_s or 0.0, name="second")
    both = msgspec.structs.replace(simulation, object=(*simulation.object, second))
    return Brought(simulate(both), healthy=True)


def _fisheye(rng: np.random.Generator) -> Brought:
    """All-sky cameras among the others."""
    keys: dict[str, Any] = {
        "lens": "fisheye",
        "intrinsics": (350.0, 350.0, 540.0, 540.0),
        "size_px": (1080, 1080),
        "distortion": (0.02, -0.01, 0.0, 0.0),
    }
    return _laid_out(rng, partial(scenery.ring, radius_m=60.0), **keys)


def _portrait(rng: np.random.Generator) -> Brought:
    """Phones held upright, lens files to match."""
    return _usual(rng, size_px=(1080, 1920), intrinsics=(1000.0, 1000.0, 540.0, 960.0))


def _rolled(rng: np.random.Generator) -> Brought:
    """Cameras that lie on their side, landscape files: only their rolls are unusual."""
    simulation = scenery.usual(rng)
    keys = {camera.id: {"roll_deg": float(rng.uniform(-60, 60))} for camera in simulation.camera}
    return Brought(simulate(scenery.changed(simulation, keys)), healthy=True)


HEALTHY: Final = (
    Kind("healthy_usual", _usual, healthy=True),
    Kind("healthy_triangle", partial(_laid_out, layout=scenery.polygon, count=3), healthy=True),
    Kind("healthy_square", partial(_laid_out, layout=scenery.polygon, count=4), healthy=True),
    Kind("healthy_arc", partial(_laid_out, layout=scenery.arc), healthy=True),
    Kind("healthy_short", _short, healthy=True),
    Kind("healthy_long", _long, healthy=True),
    Kind("healthy_wide", _wide, healthy=True),
    Kind("healthy_orbit", _orbit, healthy=True),
    Kind("healthy_zooms", _zooms, healthy=True),
    Kind(
        "healthy_lenses_1pc", partial(_usual, lens_error=LensFault(focal=0.01, centre_px=10.0, k1=0.01)), healthy=True
    ),
    Kind("healthy_30_hz", partial(_usual, frame_rate_hz=30.0, drift_px=0.5, drift_s=0.3), healthy=True),
    Kind("healthy_clutter", partial(_usual, clutter_per_frame=0.5, outlier=0.05), healthy=True),
    Kind("healthy_sparse", _sparse, healthy=True),
    Kind("healthy_drift", partial(_usual, drift_px=2.0, drift_s=2.0), healthy=True),
    Kind("healthy_shutter", _rolling_shutter, healthy=True),
    Kind("healthy_cliff", partial(_cliff, level=True), healthy=True),
    Kind("cliff_without_level", partial(_cliff, level=False)),
    Kind("healthy_ceiling", _ceiling, healthy=True),
    Kind("healthy_all_low", _all_low, healthy=True),
    Kind("healthy_two_drones", _two_drones, healthy=True),
    Kind("healthy_fisheye", _fisheye, healthy=True),
    Kind("healthy_portrait", _portrait, healthy=True),
    Kind("healthy_rolled", _rolled, healthy=True),
)
