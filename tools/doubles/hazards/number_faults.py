"""Many objects at once, and numbers that do not say which is which: exchanged where they meet, shared, drawn anew.

The track numbers of each camera are its own to begin with: nothing here lets one camera's number help another's.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from calib.simulation.description import ObjectSpec
from calib.simulation.simulation import Rows, Simulated, simulate
from calib.solving.found import Cause
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought, Fault, with_rows
from tools.doubles.hazards.table import Kind

Spoil = Callable[[Rows, np.random.Generator], Rows]
MEETING_PX: Final = 40.0  # as near as that, trackers exchange numbers
GULL_M: Final = (0.4, 0.2)


def drones(rng: np.random.Generator, count: int, cameras: int | None = None, **keys: Any) -> Simulated:
    """Several drones that wander in the same air; each camera has numbers of its own."""
    simulation = scenery.usual(rng, cameras, **keys)
    others = [scenery.wander(rng, simulation.duration_s or 0.0, name=f"drone{k}") for k in range(2, count + 1)]
    return own_numbers(simulate(msgspec.structs.replace(simulation, object=(*simulation.object, *others))), rng)


def own_numbers(simulated: Simulated, rng: np.random.Generator) -> Simulated:
    """The scene in which each camera counts its tracks its own way."""
    rows = {}
    for name, seen in simulated.rows.items():
        numbers, at = np.unique(seen.track, return_inverse=True)
        rows[name] = replace(seen, track=rng.permutation(len(numbers))[at].astype(np.int64) + 1)
    return with_rows(simulated, rows)


def spoiled(
    rng: np.random.Generator, simulated: Simulated, spoil: Spoil, *, all_share: float = 0.5, note: str = ""
) -> Brought:
    """One camera's rows spoiled, or with that chance all cameras'."""
    names = tuple(camera.id for camera in simulated.scene.cameras)
    chosen = names if rng.random() < all_share else (str(rng.choice(names)),)
    rows = {name: spoil(simulated.rows[name], rng) for name in chosen}
    note = f"{note} of {' '.join(chosen)}, {len(simulated.flights)} objects"
    return Brought(with_rows(simulated, rows), (Fault(Cause.TRACKS, chosen),), note)


def frames(rows: Rows) -> list[NDArray[np.int64]]:
    """The rows of each frame."""
    starts = np.unique(rows.t_unix_ns, return_index=True)[1]
    return np.split(np.arange(len(rows.t_unix_ns)), starts[1:])


def exchanged_where_they_meet(rows: Rows, rng: np.random.Generator) -> Rows:
    """Two numbers exchanged from where their objects came nearest in the picture: half of the meetings."""
    names = {int(number): int(number) for number in np.unique(rows.track)}
    track, near = rows.track.copy(), set[tuple[int, int]]()
    for own in frames(rows):
        now = set()
        for i in own.tolist():
            for j in own.tolist():
                one, two = int(rows.track[i]), int(rows.track[j])
                if one < two and np.linalg.norm(rows.pixels[i] - rows.pixels[j]) < MEETING_PX:
                    now.add((one, two))
        for one, two in now - near:
            if rng.random() < 0.5:
                names[one], names[two] = names[two], names[one]
        near = now
        track[own] = [names[int(number)] for number in rows.track[own]]
    return replace(rows, track=track)


def exchanged_anywhere(rows: Rows, rng: np.random.Generator, *, times: int) -> Rows:
    """All numbers drawn anew among the objects, at instants that have nothing to do with the picture."""
    numbers, at = np.unique(rows.track, return_inverse=True)
    first, last = int(rows.t_unix_ns[0]), int(rows.t_unix_ns[-1])
    when = np.sort(rng.uniform(0.1, 0.9, times) * (last - first) + first)
    piece = np.searchsorted(when, rows.t_unix_ns)
    orders = np.array([rng.permutation(len(numbers)) for _ in range(times + 1)])
    return replace(rows, track=numbers[orders[piece, at]])


def one_number(rows: Rows, _: np.random.Generator) -> Rows:
    """All objects have the same number."""
    return replace(rows, track=np.zeros_like(rows.track))


def rank(rows: Rows, rng: np.random.Generator, *, by: str) -> Rows:
    """The number is the place in the frame's list: by column, by row, or in any order."""
    order = {"u": rows.pixels[:, 0], "v": rows.pixels[:, 1], "any": rng.random(len(rows.track))}[by]
    track = np.zeros_like(rows.track)
    for own in frames(rows):
        track[own[np.argsort(order[own])]] = np.arange(len(own))
    return replace(rows, track=track)


def new_number(rows: Rows, _: np.random.Generator, *, every_s: float) -> Rows:
    """A new number every row, or for everything every so often."""
    if every_s == 0.0:
        return replace(rows, track=np.arange(len(rows.track)))
    piece = ((rows.t_unix_ns - rows.t_unix_ns[0]) // round(every_s * 1e9)).astype(np.int64)
    return replace(rows, track=piece * (int(rows.track.max()) + 1) + rows.track)


def _several(rng: np.random.Generator, spoil: Spoil, note: str = "", least: int = 2) -> Brought:
    return spoiled(rng, drones(rng, int(rng.integers(least, 5))), spoil, note=note)


def _healthy(rng: np.random.Generator, *, drones_least: int = 2, **keys: Any) -> Brought:
    simulated = drones(rng, int(rng.integers(drones_least, 5)), **keys)
    return Brought(simulated, note=f"{len(simulated.flights)} drones", healthy=True)


def _hovering(rng: np.random.Generator, *, whole_px: bool) -> Brought:
    """A drone that flies from place to place and stands still for 5 to 20 s at each; pixels as detectors round them."""
    simulation = scenery.usual(rng)
    path = [np.array(scenery.MIDDLE) + rng.uniform(-1, 1, 3) * scenery.HALF_BOX]
    while len(path) < 110:
        to = np.array(scenery.MIDDLE) + rng.uniform(-1, 1, 3) * scenery.HALF_BOX
        steps = max(2, round(float(np.linalg.norm(to - path[-1])) / 6.0))
        ease = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, steps + 1) / steps)
        path += list(path[-1] + ease[:, None] * (to - path[-1]))
        path += [path[-1] + rng.normal(0, 0.02, 3) for _ in range(int(rng.integers(5, 20)))]
    thing = scenery.through(np.array(path), step_s=1.0)
    simulated = simulate(msgspec.structs.replace(simulation, object=(thing,), duration_s=90.0))
    if whole_px:
        rows = {name: replace(own, pixels=np.round(own.pixels)) for name, own in simulated.rows.items()}
        simulated = with_rows(simulated, rows)
    return Brought(simulated, healthy=True)


def _birds(rng: np.random.Generator) -> Brought:
    """A drone, and dozens of gulls that cross the picture for 0.3 to 4 s each."""
    simulation = scenery.usual(rng, frame_rate_hz=float(rng.choice([10.0, 15.0, 25.0])))
    count, duration_s = int(rng.integers(20, 60)), simulation.duration_s or 0.0
    birds = [_bird(rng, duration_s, k) for k in range(count)]
    both = msgspec.structs.replace(simulation, object=(*simulation.object, *birds))
    return Brought(own_numbers(simulate(both), rng), note=f"{count} birds", healthy=True)


def _bird(rng: np.random.Generator, duration_s: float, number: int) -> ObjectSpec:
    lasts_s = float(rng.uniform(0.3, 4.0))
    start = np.array(scenery.MIDDLE) + rng.uniform(-1, 1, 3) * (50, 50, 20)
    to = rng.normal(0, 1, 3) * (1, 1, 0.2)
    velocity = 12.0 * to / np.linalg.norm(to)
    t = np.arange(4) * lasts_s / 3
    path = start + np.outer(t, velocity) + np.outer(t**2, rng.normal(0, 1.5, 3))
    gull = scenery.through(path, step_s=lasts_s / 3, name=f"bird{number}")
    width, height = GULL_M
    return msgspec.structs.replace(
        gull, start_s=float(rng.uniform(1, duration_s - 5)), kind="bird", width_m=width, height_m=height
    )


NUMBERS: Final = (
    Kind("exchanged_at_meetings", partial(_several, spoil=exchanged_where_they_meet)),
    Kind("exchanged_any_once", partial(_several, spoil=partial(exchanged_anywhere, times=1))),
    Kind("exchanged_any_often", partial(_several, spoil=partial(exchanged_anywhere, times=9))),
    Kind("one_number_for_all", partial(_several, spoil=one_number)),
    Kind("rank_by_column", partial(_several, spoil=partial(rank, by="u"))),
    Kind("rank_by_row", partial(_several, spoil=partial(rank, by="v"))),
    Kind("rank_in_any_order", partial(_several, spoil=partial(rank, by="any"))),
    Kind("several_new_each_row", partial(_several, spoil=partial(new_number, every_s=0.0))),
    Kind("several_new_each_0.9_s", partial(_several, spoil=partial(new_number, every_s=0.9))),
    Kind("healthy_several", _healthy, healthy=True),
    Kind("healthy_several_missed", partial(_healthy, dropout=0.1, outlier=0.02), healthy=True),
    Kind("healthy_hovering", partial(_hovering, whole_px=False), healthy=True),
    Kind("healthy_hovering_whole_px", partial(_hovering, whole_px=True), healthy=True),
    Kind("healthy_birds", _birds, healthy=True),
)
