"""Rows that are not of what their camera saw: numbers exchanged, sentinels for unseen frames, positions held."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from calib.simulation.simulation import Rows, Simulated, simulate
from calib.solving.found import Cause
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought, Fault, with_rows
from tools.doubles.hazards.table import Kind

LARGE_M: Final = (1.5, 0.5)  # width and height of a large drone
Spoil = Callable[[Rows, np.random.Generator], Rows]


def _spoiled(
    rng: np.random.Generator, simulated: Simulated, names: tuple[str, ...], spoil: Spoil, note: str = ""
) -> Brought:
    """The scene in which some cameras' rows were spoiled."""
    rows = {name: spoil(simulated.rows[name], rng) for name in names}
    return Brought(with_rows(simulated, rows), (Fault(Cause.TRACKS, names),), note or f"of {' '.join(names)}")


def _two_drones(rng: np.random.Generator, count: int | None = None) -> Simulated:
    simulation = scenery.usual(rng, count)
    second = scenery.wander(rng, simulation.duration_s or 0.0, name="second")
    return simulate(msgspec.structs.replace(simulation, object=(*simulation.object, second)))


def _whom(rng: np.random.Generator, simulated: Simulated, share: float) -> tuple[str, ...]:
    """One camera, or with that chance all of them."""
    names = [camera.id for camera in simulated.scene.cameras]
    return tuple(names) if rng.random() < share else (str(rng.choice(names)),)


def _exchanged_at(rows: Rows, times_ns: NDArray[np.int64]) -> Rows:
    """Numbers 1 and 2 exchanged from each of the instants on."""
    odd = np.searchsorted(np.sort(times_ns), rows.t_unix_ns, side="right") % 2 == 1
    return replace(rows, track=np.where(odd & (rows.track <= 2), 3 - rows.track, rows.track))


def _numbers_exchanged(rng: np.random.Generator, *, often: bool) -> Brought:
    """Two drones whose numbers a tracker exchanges: once in one camera, or every few seconds in all."""
    simulated = _two_drones(rng)
    names = _whom(rng, simulated, 1.0 if often else 0.0)
    every_s = float(rng.uniform(4, 12))

    def exchange(rows: Rows, draw: np.random.Generator) -> Rows:
        first, last = int(rows.t_unix_ns[0]), int(rows.t_unix_ns[-1])
        count = max(1, round((last - first) * 1e-9 / every_s)) if often else 1
        return _exchanged_at(rows, first + (draw.uniform(0.2, 0.8, count) * (last - first)).astype(np.int64))

    return _spoiled(rng, simulated, names, exchange, f"every {every_s:.0f} s" if often else f"once in {names[0]}")


def _index_as_number(rng: np.random.Generator) -> Brought:
    """The number is the place in the frame's list, from left to right."""

    def indexed(rows: Rows, _: np.random.Generator) -> Rows:
        order = np.lexsort((rows.pixels[:, 0], rows.t_unix_ns))
        t = rows.t_unix_ns[order]
        first = np.searchsorted(t, t, side="left")
        return Rows(t, rows.pixels[order], np.arange(len(t)) - first, rows.source[order], rows.size_px[order])

    simulated = _two_drones(rng)
    return _spoiled(rng, simulated, _whom(rng, simulated, 1.0), indexed)


def _new_number(rng: np.random.Generator, *, every_s: float) -> Brought:
    """No tracker worth the name: a new number every so often."""

    def renumbered(rows: Rows, _: np.random.Generator) -> Rows:
        if every_s == 0.0:
            return replace(rows, track=np.arange(len(rows.track)))
        return replace(rows, track=((rows.t_unix_ns - rows.t_unix_ns[0]) // round(every_s * 1e9)).astype(np.int64))

    simulated = simulate(scenery.usual(rng))
    return _spoiled(rng, simulated, _whom(rng, simulated, 1.0), renumbered)


def _runs(count: int, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(count,) runs of 0.5 to 4 s at 10 Hz, that share of the whole in all."""
    hit = np.zeros(count, bool)
    while hit.mean() < share:
        start, length = int(rng.integers(count)), int(rng.integers(5, 40))
        hit[start : start + length] = True
    return hit


def _sentinel(rng: np.random.Generator, *, share: float, value: tuple[float, float] | None) -> Brought:
    """Unseen frames written as a row all the same: zeros, minus ones, or where it was last seen (None)."""

    def written(rows: Rows, draw: np.random.Generator) -> Rows:
        hit = _runs(len(rows.track), share, draw)
        hit[0] = False
        if value is not None:
            return replace(rows, pixels=np.where(hit[:, None], value, rows.pixels))
        last = np.maximum.accumulate(np.where(hit, 0, np.arange(len(hit))))
        return replace(rows, pixels=rows.pixels[last])

    simulated = simulate(scenery.usual(rng))
    return _spoiled(rng, simulated, _whom(rng, simulated, 0.6), written, f"{share:.0%} of the rows")


def _frozen_picture(rng: np.random.Generator) -> Brought:
    """One camera's last row is said again for the rest of the flight: the decoder hangs."""

    def frozen(rows: Rows, draw: np.random.Generator) -> Rows:
        at = round(len(rows.track) * float(draw.uniform(0.5, 0.9)))
        return replace(rows, pixels=rows.pixels[np.minimum(np.arange(len(rows.track)), at)])

    simulated = simulate(scenery.usual(rng))
    return _spoiled(rng, simulated, _whom(rng, simulated, 0.0), frozen)


def _other_object(rng: np.random.Generator) -> Brought:
    """One camera follows something else than the others do."""
    simulated = _two_drones(rng, scenery.usual_count(rng, 4))
    names = [camera.id for camera in simulated.scene.cameras]
    odd = str(rng.choice(names))
    kept = {name: _only(simulated.rows[name], 2 if name == odd else 1) for name in names}
    return Brought(with_rows(simulated, kept), (Fault(Cause.TRACKS, (odd,)),), f"{odd} follows another")


def _only(rows: Rows, source: int) -> Rows:
    keep = rows.source == source
    track = np.ones(int(keep.sum()), np.int64)
    return Rows(rows.t_unix_ns[keep], rows.pixels[keep], track, rows.source[keep], rows.size_px[keep])


def _box_centre_off(rng: np.random.Generator) -> Brought:
    """A large drone whose box's centre is not the drone's, by a share of its size that each detector has its own of."""
    simulation = scenery.usual(rng)
    drone = msgspec.structs.replace(simulation.object[0], width_m=LARGE_M[0], height_m=LARGE_M[1])
    simulated = simulate(msgspec.structs.replace(simulation, object=(drone,)))

    def shifted(rows: Rows, draw: np.random.Generator) -> Rows:
        return replace(rows, pixels=rows.pixels + rows.size_px * draw.uniform(-0.4, 0.4, 2))

    names = tuple(camera.id for camera in simulated.scene.cameras)
    return _spoiled(rng, simulated, names, shifted)


def _clutter(rng: np.random.Generator) -> Brought:
    """One camera is half clutter: leaves, insects."""
    simulation = scenery.usual(rng)
    name = scenery.some(rng, simulation)
    outlier = float(rng.choice([0.2, 0.4, 0.6]))
    simulated = simulate(scenery.changed(simulation, {name[0]: {"outlier": outlier}}))
    return Brought(simulated, (Fault(Cause.TRACKS, name),), f"{outlier:.0%} of {name[0]}'s rows")


TRACKS: Final = (
    Kind("numbers_exchanged_once", partial(_numbers_exchanged, often=False)),
    Kind("numbers_exchanged_often", partial(_numbers_exchanged, often=True)),
    Kind("number_is_index", _index_as_number),
    Kind("new_number_each_row", partial(_new_number, every_s=0.0)),
    Kind("new_number_each_second", partial(_new_number, every_s=0.9)),
    Kind("zeros_9pc", partial(_sentinel, share=0.09, value=(0.0, 0.0))),
    Kind("zeros_30pc", partial(_sentinel, share=0.3, value=(0.0, 0.0))),
    Kind("minus_ones", partial(_sentinel, share=0.15, value=(-1.0, -1.0))),
    Kind("held_positions", partial(_sentinel, share=0.3, value=None)),
    Kind("frozen_picture", _frozen_picture),
    Kind("other_object_one", _other_object),
    Kind("box_centre_off", _box_centre_off),
    Kind("clutter_one", _clutter),
)
