"""Positions that are not where the tripods are: exchanged, in other units, above another zero, rounded, mistyped."""

from dataclasses import replace
from functools import partial
from typing import Any, Final

import msgspec
import numpy as np

from calib.geodesy import enu_to_geodetic, geodetic_to_enu
from calib.observations import SiteCamera
from calib.simulation.description import Simulation
from calib.simulation.simulation import simulate
from calib.solving.found import Cause
from calib.station.config import UNSTATED_SIGMA_M
from edge.common.arrays import Array
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought, Fault, with_rows, with_sites
from tools.doubles.hazards.table import Kind

GEOID_M: Final = 47.6  # between the ellipsoid and the sea in central Europe
DATE_LINE: Final = (-16.8, 180.0, 12.0)  # Taveuni


def _exchanged(simulation: Simulation, one: str, other: str) -> Brought:
    """Two cameras' surveyed positions, each written at the other."""
    places = {camera.id: np.array(camera.centre_enu) for camera in simulation.camera}
    to_other = places[other] - places[one]
    keys = {
        one: {"survey_error_m": scenery.metres3(to_other)},
        other: {"survey_error_m": scenery.metres3(-to_other)},
    }
    fault = Fault(Cause.POSITION, (one, other))
    return Brought(simulate(scenery.changed(simulation, keys)), (fault,), f"{one} and {other} exchanged")


def _figure(rng: np.random.Generator, count: int) -> Simulation:
    duration_s = float(rng.choice(scenery.DURATIONS_S))
    centres = scenery.polygon(
        rng, count, radius_m=float(rng.uniform(70, 130)), off_m=float(rng.choice([0.0, 1.0, 4.0]))
    )
    return scenery.scene(rng, scenery.stand(centres), scenery.wander(rng, duration_s), duration_s=duration_s)


def _swap_of_three(rng: np.random.Generator) -> Brought:
    simulation = _figure(rng, 3) if rng.random() < 0.5 else scenery.usual(rng, 3)
    one, other = scenery.some(rng, simulation, 2)
    return _exchanged(simulation, one, other)


def _swap_in_square(rng: np.random.Generator, *, apart: int) -> Brought:
    first = int(rng.integers(4))
    return _exchanged(_figure(rng, 4), scenery.name_of(first), scenery.name_of((first + apart) % 4))


def _swap_random(rng: np.random.Generator) -> Brought:
    simulation = scenery.usual(rng, scenery.usual_count(rng, 4))
    one, other = scenery.some(rng, simulation, 2)
    return _exchanged(simulation, one, other)


def _three_files_rotated(rng: np.random.Generator) -> Brought:
    simulated = simulate(scenery.usual(rng))
    names = rng.permutation([camera.id for camera in simulated.scene.cameras])[:3].tolist()
    rotated = {name: simulated.rows[other] for name, other in zip(names, [*names[1:], names[0]], strict=True)}
    fault = Fault(Cause.TRACKS, tuple(names))
    return Brought(with_rows(simulated, rotated), (fault,), f"files of {' '.join(names)} rotated")


def _low(rng: np.random.Generator, count: int, guilty: int) -> Brought:
    simulation = scenery.usual(rng, count)
    names = scenery.some(rng, simulation, guilty)
    low_m = GEOID_M * float(rng.uniform(0.3, 1.1)) * float(rng.choice([-1, 1]))
    keys = {name: {"survey_error_m": (0.0, 0.0, -low_m)} for name in names}
    return Brought(simulate(scenery.changed(simulation, keys)), (Fault(Cause.POSITION, names),), f"{low_m:+.1f} m low")


def _mistyped(rng: np.random.Generator) -> Brought:
    """One digit of one coordinate."""
    simulation = scenery.usual(rng)
    name = scenery.some(rng, simulation)
    error = np.zeros(3)
    error[rng.integers(3)] = float(rng.choice([-1, 1])) * float(rng.choice([0.3, 1.0, 3.0, 10.0, 30.0, 100.0]))
    keys = {name[0]: {"survey_error_m": scenery.metres3(error)}}
    fault = Fault(Cause.POSITION, name)
    return Brought(simulate(scenery.changed(simulation, keys)), (fault,), f"{name[0]} off by {np.abs(error).max():g} m")


def _all_off(rng: np.random.Generator) -> Brought:
    """Every position is off by far more than its receiver claims: a float solution, or one that was fixed wrongly."""
    simulation = scenery.usual(rng, scenery.usual_count(rng, 4))
    off_m = float(rng.choice([0.1, 0.2, 0.4]))
    names = tuple(camera.id for camera in simulation.camera)
    keys = {name: {"survey_error_m": scenery.metres3(rng.normal(0, off_m, 3))} for name in names}
    fault = Fault(Cause.POSITION, names)
    return Brought(simulate(scenery.changed(simulation, keys)), (fault,), f"all off by {off_m:g} m")


def _written(site: SiteCamera, enu: Array, sigma_m: tuple[float, float, float] | None = None) -> SiteCamera:
    covariance = site.position_covariance if sigma_m is None else np.diag(np.square(sigma_m))
    return replace(site, position_enu=enu, position_covariance=covariance)


def _retyped(
    rng: np.random.Generator, how: Any, count: int | None = None, guilty: int | None = None, **keys: Any
) -> Brought:
    """Positions (3,) geodetic, typed again in a way of one's own. guilty: how many; all if None."""
    simulation = scenery.usual(rng, count, **keys)
    simulated = simulate(simulation)
    names = scenery.some(rng, simulation, guilty or len(simulation.camera))
    sites = {}
    for site in simulated.scene.cameras:
        if site.id in names and site.position_enu is not None:
            typed = how(enu_to_geodetic(site.position_enu, simulation.origin)[0])
            sites[site.id] = _written(site, geodetic_to_enu(typed, simulation.origin)[0])
    return Brought(with_sites(simulated, sites), (Fault(Cause.POSITION, names),))


def _rounded(geodetic: Array, decimals: int) -> Array:
    lat, lon, height = geodetic.tolist()
    return np.array([round(lat, decimals), round(lon, decimals), round(height)])


def _lat_lon_exchanged(geodetic: Array) -> Array:
    return geodetic[[1, 0, 2]]


def _minutes_as_decimals(geodetic: Array) -> Array:
    """47 degrees 24.51 minutes, typed as 47.2451: with as many decimals as were read off."""
    degrees = np.floor(geodetic[:2])
    return np.array([*np.round(degrees + (geodetic[:2] - degrees) * 0.6, 4), geodetic[2]])


def _date_line(rng: np.random.Generator) -> Brought:
    moved = msgspec.structs.replace(scenery.usual(rng), origin=DATE_LINE)
    return Brought(simulate(moved), healthy=True, says_origin=False)


def _registered_twice(rng: np.random.Generator) -> Brought:
    """One camera's stream under two names: the second stands elsewhere."""
    simulated = simulate(scenery.usual(rng))
    one, other = rng.permutation([camera.id for camera in simulated.scene.cameras])[:2].tolist()
    copied = with_rows(simulated, {other: simulated.rows[one]})
    return Brought(copied, (Fault(Cause.TRACKS, (one, other)),), f"{other} shows what {one} shows")


EXCHANGED: Final = (
    Kind("swap_of_3", _swap_of_three),
    Kind("swap_diagonal_of_4", partial(_swap_in_square, apart=2)),
    Kind("swap_neighbours_of_4", partial(_swap_in_square, apart=1)),
    Kind("swap_random", _swap_random),
    Kind("three_files_rotated", _three_files_rotated),
    Kind("stream_twice", _registered_twice),
)
MISTAKEN: Final = (
    Kind("height_msl_one_of_3", partial(_low, count=3, guilty=1)),
    Kind("height_msl_one_of_4", partial(_low, count=4, guilty=1)),
    Kind("height_msl_two_of_4", partial(_low, count=4, guilty=2)),
    Kind("mistyped_one", _mistyped),
    Kind("survey_all_off", _all_off),
    Kind("rounded_4", partial(_retyped, how=partial(_rounded, decimals=4), survey_sigma_m=UNSTATED_SIGMA_M)),
    Kind("rounded_5", partial(_retyped, how=partial(_rounded, decimals=5), survey_sigma_m=UNSTATED_SIGMA_M)),
    Kind("lat_lon_all", partial(_retyped, how=_lat_lon_exchanged)),
    Kind("lat_lon_one_of_3", partial(_retyped, how=_lat_lon_exchanged, count=3, guilty=1)),
    Kind("lat_lon_one_of_4", partial(_retyped, how=_lat_lon_exchanged, count=4, guilty=1)),
    Kind("minutes_as_decimals", partial(_retyped, how=_minutes_as_decimals)),
    Kind("date_line", _date_line, healthy=True),
)
