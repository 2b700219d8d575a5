"""Tripods that do not stand still, and cameras that share too little: knocked, moved, zoomed, without common views."""

from functools import partial
from typing import Any, Final

import msgspec
import numpy as np

from calib.simulation.description import Blind, Bump
from calib.simulation.simulation import simulate
from calib.solving.found import Cause
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought, Fault, with_rows
from tools.doubles.hazards.table import Kind

TURN_S: Final = 20.0  # how long each pair looks while the other is blind


def _bumped(rng: np.random.Generator, *, degrees: float = 0.0, metres: float = 0.0) -> Brought:
    """One tripod is knocked or moved about halfway."""
    simulation = scenery.usual(rng, int(rng.choice([3, 4, 4, 5])))
    name = scenery.some(rng, simulation)
    at_s = (simulation.duration_s or 60.0) * float(rng.uniform(0.35, 0.65))
    turn, way = (rng.normal(0, 1, 3) for _ in range(2))
    turn[2] *= 0.3  # a knock turns the view more than it rolls it
    bump = Bump(
        at_s=at_s,
        rotation_deg=scenery.metres3(degrees * turn / np.linalg.norm(turn)),
        shift_m=scenery.metres3(metres * way / np.linalg.norm(way)),
    )
    simulated = simulate(scenery.changed(simulation, {name[0]: {"bump": (bump,)}}))
    return Brought(
        simulated, (Fault(Cause.POSE, name),), f"{name[0]} at {at_s:.0f} s, {len(simulation.camera)} cameras"
    )


def _all_settle(rng: np.random.Generator) -> Brought:
    """Every tripod sinks a little into wet ground: 0.07 degrees halfway."""
    simulation = scenery.usual(rng)
    keys: dict[str, dict[str, Any]] = {}
    for camera in simulation.camera:
        turn = 0.07 * rng.normal(0, 1, 3) / np.sqrt(3)
        keys[camera.id] = {"bump": (Bump(at_s=30.0, rotation_deg=scenery.metres3(turn)),)}
    names = tuple(camera.id for camera in simulation.camera)
    return Brought(simulate(scenery.changed(simulation, keys)), (Fault(Cause.POSE, names),))


def _two_pairs(rng: np.random.Generator, *, bound: bool) -> Brought:
    """Two pairs that take turns: no camera of one ever sees the object together with one of the other."""
    simulation = scenery.usual(rng, 4, **({} if bound else {"clock_bound_s": None}))
    duration_s = simulation.duration_s or 60.0
    starts = np.arange(0.0, duration_s, 2 * TURN_S)
    blind = [
        tuple(Blind(from_s=float(at + turn * TURN_S), to_s=float(at + (turn + 1) * TURN_S)) for at in starts)
        for turn in (0, 1)
    ]
    keys = {camera.id: {"blind": blind[k // 2]} for k, camera in enumerate(simulation.camera)}
    names = tuple(camera.id for camera in simulation.camera)
    simulated = simulate(scenery.changed(simulation, keys))
    return Brought(simulated, (Fault(Cause.VIEWS, names),), "pairs take turns")


def _two_fields(rng: np.random.Generator) -> Brought:
    """Two pairs, each with a drone of its own."""
    simulation = scenery.usual(rng, 4)
    second = scenery.wander(rng, simulation.duration_s or 60.0, name="second")
    simulated = simulate(msgspec.structs.replace(simulation, object=(*simulation.object, second)))
    names = tuple(camera.id for camera in simulated.scene.cameras)
    kept = {}
    for number, name in enumerate(names):
        rows = simulated.rows[name]
        own = rows.source == 1 + number // 2
        columns = (rows.t_unix_ns, rows.pixels, np.ones(len(own), np.int64), rows.source, rows.size_px)
        kept[name] = type(rows)(*(column[own] for column in columns))
    return Brought(with_rows(simulated, kept), (Fault(Cause.VIEWS, names),), "each pair its own drone")


POSES: Final = (
    Kind("knock_0.15", partial(_bumped, degrees=0.15)),
    Kind("knock_0.5", partial(_bumped, degrees=0.5)),
    Kind("knock_3", partial(_bumped, degrees=3.0)),
    Kind("moved_2m", partial(_bumped, metres=2.0)),
    Kind("all_settle", _all_settle),
    Kind("pairs_take_turns", partial(_two_pairs, bound=True)),
    Kind("pairs_take_turns_no_clocks", partial(_two_pairs, bound=False)),
    Kind("pairs_two_drones", _two_fields),
)
