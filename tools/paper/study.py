"""The study's scene, its levels of error, what was published for each and what is to be reached.

One flight, three cameras, 300 samples, errors uniform in [-e, e] per coordinate. The study counts its flight in steps
of a natural parameter and knows no seconds; here a sample is taken every 0.2 s, which makes the flight 59.8 s long and
a step 4.27 s. Clocks, shutters and lenses are exact and declared so, and the survey is declared as good as it is.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from calib.observations import Scene, SiteCamera
from calib.simulation.description import CameraSpec, ObjectSpec, Simulation
from calib.simulation.simulation import Simulated, Watched, disturb, watch
from edge.common.arrays import Array

# fmt: off
WAYPOINTS_ENU: Final = (
    (70, 0, 30), (0, 65, 35), (-60, 0, 40), (0, -55, 45), (50, 0, 50), (0, 45, 55), (-40, 0, 60), (0, -35, 65),
    (30, 0, 70), (0, 25, 75), (-20, 0, 80), (0, -15, 85), (10, 0, 90), (0, 5, 95), (0, 0, 100),
)
# fmt: on
SAMPLES: Final = 300
INTERVAL_S: Final = 0.2  # between samples: a whole number of trajectory rows, so that samples need no interpolation
RADIUS_M: Final = 100.0
LOOK_AT_ENU: Final = (0.0, 0.0, 65.0)
MARGIN_S: Final = 1e-9  # a step is longer by this, so that rounding does not put the last sample after the flight's end
EXACT_SURVEY_M: Final = 1e-6  # one sigma: what a survey without error is declared as
EXACT_CLOCK_S: Final = 1e-9  # one sigma, likewise
EXACT_FOCAL_PX: Final = 1e-9  # one sigma, likewise


@dataclass(frozen=True)
class Level:
    """One column of the study: the errors' half widths, the scene's size, and the two mean RMSE to compare with."""

    study: str
    value: float
    pixel_px: float
    position_m: float
    scale: float
    published_m: float
    target_m: float

    @property
    def name(self) -> str:
        """What the tables call it."""
        return f"{self.study} {self.value:g}"

    @property
    def exact(self) -> bool:
        """Whether nothing is wrong at all."""
        return self.pixel_px == self.position_m == 0


def _levels(study: str, rows: list[tuple[float, float, float]]) -> tuple[Level, ...]:
    def level(value: float, published: float, target: float) -> Level:
        if study == "pixel error":
            return Level(study, value, value, 0.0, 1.0, published, target)
        if study == "position error":
            return Level(study, value, 0.0, value, 1.0, published, target)
        return Level(study, value, 3.0, 0.2, value, published, target)

    return tuple(level(*row) for row in rows)


# fmt: off
LEVELS: Final = (
    *_levels("pixel error", [  # px; 0 is the study without noise
        (0, 3.2e-4, 1e-9), (1, 1.38, 0.055), (2, 1.35, 0.10), (4, 1.88, 0.18), (6, 2.82, 0.27), (8, 3.41, 0.35),
        (10, 3.76, 0.43),
    ]),
    *_levels("scene scale", [  # with 3 px and 0.2 m
        (0.25, 0.39, 0.16), (0.5, 0.73, 0.18), (1, 1.44, 0.21), (1.5, 2.14, 0.26), (2, 2.91, 0.32),
    ]),
    *_levels("position error", [  # m; the survey's own limit: nobody can do better from three positions
        (0.1, 0.078, 0.078), (0.2, 0.155, 0.155), (0.4, 0.311, 0.311), (0.6, 0.464, 0.464), (0.8, 0.616, 0.616),
        (1.0, 0.767, 0.767),
    ]),
)
# fmt: on


def simulation(level: Level, seed: int) -> Simulation:
    """The scene of a level as a description that tools/simulate understands."""
    cameras = tuple(_camera(number, level) for number in range(3))
    waypoints = tuple((level.scale * x, level.scale * y, level.scale * z) for x, y, z in WAYPOINTS_ENU)
    step_s = INTERVAL_S * (SAMPLES - 1) / (len(WAYPOINTS_ENU) - 1) + MARGIN_S
    flight = ObjectSpec(waypoints_enu=waypoints, step_s=step_s)
    return Simulation(name=level.name, seed=seed, object=(flight,), camera=cameras)


def _camera(number: int, level: Level) -> CameraSpec:
    angle = 2 * np.pi * number / 3
    east, north = level.scale * RADIUS_M * np.cos(angle), level.scale * RADIUS_M * np.sin(angle)
    x, y, z = LOOK_AT_ENU
    return CameraSpec(
        id=f"cam{number + 1}",
        centre_enu=(float(east), float(north), 0.0),
        look_at_enu=(level.scale * x, level.scale * y, level.scale * z),
        survey_sigma_m=(level.position_m,) * 3,
        survey_error="uniform",
        frames=SAMPLES,
        frame_rate_hz=1 / INTERVAL_S,
        noise="uniform",
        noise_px=level.pixel_px,
    )


@lru_cache(maxsize=1)
def _watched(level: Level, seed: int) -> Watched:
    return watch(simulation(level, seed))


def draw(level: Level, seed: int, trial: int) -> Simulated:
    """One trial of a level: what is believed and seen, and the truth. Same arguments, same numbers."""
    simulated = disturb(_watched(level, seed), trial)
    cameras = tuple(_declared(camera, level) for camera in simulated.scene.cameras)
    return replace(simulated, scene=replace(simulated.scene, cameras=cameras))


def _declared(camera: SiteCamera, level: Level) -> SiteCamera:
    variance = max(level.position_m**2 / 3, EXACT_SURVEY_M**2)  # of a uniform distribution
    return replace(
        camera,
        lens=replace(camera.lens, focal_sigma_px=EXACT_FOCAL_PX),
        position_covariance=variance * np.eye(3),
        clock_bound_s=EXACT_CLOCK_S,
        readout_s=0.0,
    )


def truth_enu(simulated: Simulated) -> Array:
    """(300, 3) where the object was at the samples."""
    stamps = simulated.start_unix_ns + np.arange(SAMPLES, dtype=np.int64) * round(INTERVAL_S * 1e9)
    return simulated.truth_enu(stamps)


def seen(scene: Scene) -> list[Array]:
    """Each camera's (300, 2) pixels in the order of the samples. Raises ValueError if a sample was not seen by all."""
    pixels = [scene.observations[camera.id].pixels for camera in scene.cameras]
    if any(len(own) != SAMPLES for own in pixels):
        raise ValueError("the study's cameras must see every sample")
    return pixels
