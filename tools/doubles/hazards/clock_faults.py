"""Stamps that are not the time: an hour off, counted and not measured, stepped, of a rate that was rounded."""

from dataclasses import replace
from functools import partial
from typing import Any, Final

import msgspec
import numpy as np

from calib.simulation.description import ClockStep, Simulation
from calib.simulation.simulation import Rows, simulate
from calib.solving.found import Cause
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought, Fault, with_rows
from tools.doubles.hazards.table import Kind

ORBIT_S: Final = 24.0  # once around a point of interest
PHONES_S: Final = 1.5  # how far phones are off one another


def _off(rng: np.random.Generator, seconds: tuple[float, ...], *, bound: bool = True) -> Brought:
    """One camera's clock is off by whole hours, by leap seconds, by a little; its bound denies it."""
    simulation = scenery.usual(rng, scenery.usual_count(rng), **({} if bound else {"clock_bound_s": None}))
    name, offset = scenery.some(rng, simulation)[0], float(rng.choice(seconds)) * float(rng.choice([-1, 1]))
    simulated = simulate(simulation)
    rows = simulated.rows[name]
    late = replace(rows, t_unix_ns=rows.t_unix_ns + round(offset * 1e9))
    fault = Fault(Cause.CLOCK, (name,))
    return Brought(with_rows(simulated, {name: late}), (fault,), f"{name} {offset:+g} s")


def _orbit(rng: np.random.Generator, *, count: int | None = None, off_s: float = 0.0) -> Brought:
    """A point of interest circled by a drone, phones without any bound on their clocks.

    A level circle looks from each camera as it does from any other a while later: where the clocks are off and it
    hardly bobs, nobody can know by how much, and a refusal is right.
    """
    radius_m, bob_m = float(rng.uniform(30, 50)), float(rng.choice([0.5, 4.0]))
    t = np.arange(-scenery.BEFORE_S, 90.0 + scenery.AFTER_S, 1.0)
    angle = 2 * np.pi * t / ORBIT_S + rng.uniform(0, 6)
    path = np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle), 45 + bob_m * np.sin(2.3 * angle)])
    thing = scenery.through(path, step_s=1.0)
    cameras = scenery.stand(scenery.ring(rng, count or int(rng.choice([3, 4]))), clock_bound_s=None)
    simulation = scenery.scene(rng, cameras, thing, duration_s=90.0)
    keys = {camera.id: {"clock_offset_s": float(rng.uniform(-off_s, off_s))} for camera in cameras}
    simulated = simulate(scenery.changed(simulation, keys) if off_s else simulation)
    return Brought(simulated, note=f"bob {bob_m:g} m", healthy=off_s == 0.0, time_free=True)


def _phones(rng: np.random.Generator) -> Brought:
    """A usual flight, phones whose clocks are seconds apart and say nothing of it."""
    simulation = scenery.usual(rng, clock_bound_s=None)
    keys = {
        camera.id: {"clock_offset_s": float(rng.uniform(-PHONES_S, PHONES_S)), "clock_rate": float(rng.normal(0, 2e-5))}
        for camera in simulation.camera
    }
    return Brought(simulate(scenery.changed(simulation, keys)), healthy=True, time_free=True)


def _of_one(rng: np.random.Generator, keys: dict[str, Any], note: str, count: int | None = None) -> Brought:
    """Keys of one camera's clock."""
    simulation = scenery.usual(rng, count)
    name = scenery.some(rng, simulation)
    simulated = simulate(scenery.changed(simulation, {name[0]: keys}))
    return Brought(simulated, (Fault(Cause.CLOCK, name),), f"{name[0]} {note}")


def _stepped(rng: np.random.Generator) -> Brought:
    """The box restarts, or its clock is set, in the middle of the flight."""
    step_s = float(rng.choice([0.2, 0.5, 2.0])) * float(rng.choice([-1, 1]))
    at_s = float(rng.uniform(20, 40))
    return _of_one(rng, {"clock_step": (ClockStep(at_s=at_s, step_s=step_s),)}, f"{step_s:+g} s at {at_s:.0f} s")


def _rated(rng: np.random.Generator) -> Brought:
    """A rate that was rounded: 29.83 frames a second taken for 30, 29.97 for 30, 25 for 24.95."""
    rate = float(rng.choice([30 / 29.83 - 1, 30 / 29.97 - 1, 25 / 24.95 - 1])) * float(rng.choice([-1, 1]))
    return _of_one(rng, {"clock_rate": rate}, f"{1e6 * rate:+.0f} ppm")


def _counted(rng: np.random.Generator, *, bursts: bool) -> Brought:
    """Frames are dropped, and the stamps counted from those that came: the clock falls behind in steps."""
    simulation = _longest(scenery.usual(rng))
    name = scenery.some(rng, simulation)[0]
    simulated = simulate(simulation)
    rows = simulated.rows[name]
    every, period_ns = (150, 1e9) if bursts else (60, 1e8)
    lost = np.cumsum(rng.random(len(rows.track)) < 1 / every)
    counted = rows.t_unix_ns - (lost * period_ns).astype(np.int64)
    keep = np.concatenate([[True], np.diff(lost) == 0])
    order = np.argsort(counted[keep], kind="stable")
    columns = (counted, rows.pixels, rows.track, rows.source, rows.size_px)
    late = Rows(*(column[keep][order] for column in columns))
    fault = Fault(Cause.CLOCK, (name,))
    return Brought(with_rows(simulated, {name: late}), (fault,), f"{name} {lost[-1]} times")


def _longest(simulation: Simulation) -> Simulation:
    """The same for 75 s at least."""
    return msgspec.structs.replace(simulation, duration_s=max(75.0, simulation.duration_s or 0.0))


CLOCKS: Final = (
    Kind("clock_hour_off", partial(_off, seconds=(3600.0, 7200.0, 37.0))),
    Kind("clock_leap_seconds", partial(_off, seconds=(18.0,), bound=False)),
    Kind("clock_off_little", partial(_off, seconds=(0.03, 0.1, 0.5))),
    Kind("clock_step", _stepped),
    Kind("clock_rate", _rated),
    Kind("stamps_counted", partial(_counted, bursts=False)),
    Kind("stamps_counted_bursts", partial(_counted, bursts=True)),
    Kind("orbit_no_bound", _orbit, healthy=True),
    Kind("orbit_phones", partial(_orbit, off_s=PHONES_S)),
    Kind("phones", _phones, healthy=True),
)
