"""Rows that no camera saw: constants and last positions written for unseen frames, pictures that froze, copies."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.simulation.simulation import Rows, simulate
from calib.solving.found import Cause
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought, Fault, with_rows
from tools.doubles.hazards.number_faults import drones, frames, spoiled
from tools.doubles.hazards.table import Kind

CORNERS: Final = ((0.0, 0.0), (1919.0, 1079.0), (1920.0, 1080.0), (0.0, 1079.0))
WRITTEN: Final = (*CORNERS, (-1.0, -1.0), (960.0, 540.0), (1.0, 1.0))


def _hidden(rows: Rows, rng: np.random.Generator, share: float) -> NDArray[np.bool_]:
    """(N,) rows of frames in which nothing was seen: runs of 0.2 to 4 s."""
    times = np.unique(rows.t_unix_ns)
    hit = np.zeros(len(times), bool)
    while hit.mean() < share:
        start = int(rng.integers(len(times)))
        hit[start : start + int(rng.integers(2, 40))] = True
    return np.isin(rows.t_unix_ns, times[hit])


def _constant(rows: Rows, rng: np.random.Generator, *, share: float, whole_px: bool = False) -> Rows:
    """A constant for each unseen object."""
    hit = _hidden(rows, rng, share)
    value = WRITTEN[int(rng.integers(len(WRITTEN)))]
    pixels = np.round(rows.pixels) if whole_px else rows.pixels
    return replace(rows, pixels=np.where(hit[:, None], value, pixels))


def _held(rows: Rows, rng: np.random.Generator, *, share: float, decimals: int) -> Rows:
    """Where each object was seen last."""
    hit = _hidden(rows, rng, share)
    pixels = np.round(rows.pixels, decimals)
    for number in np.unique(rows.track):
        own = np.flatnonzero(rows.track == number)
        last = np.maximum.accumulate(np.where(hit[own], 0, np.arange(len(own))))
        pixels[own] = pixels[own[last]]
    return replace(rows, pixels=pixels)


def _frozen(rows: Rows, rng: np.random.Generator, *, back: bool) -> Rows:
    """The picture hangs: every frame shows again what one showed, for the rest or for some seconds."""
    parts = frames(rows)
    at = round(len(parts) * float(rng.uniform(0.3, 0.7)))
    until = at + round(len(parts) * float(rng.uniform(0.05, 0.2))) if back else len(parts)
    keep = np.concatenate([*parts[: at + 1], *parts[until:]])
    still = parts[at]
    times = [rows.t_unix_ns[own[0]] for own in parts[at + 1 : until]]

    t = np.concatenate([rows.t_unix_ns[keep], np.repeat(times, len(still)).astype(np.int64)])
    which = np.concatenate([keep, np.tile(still, len(times))])
    order = np.argsort(t, kind="stable")
    which = which[order]
    return Rows(t[order], rows.pixels[which], rows.track[which], rows.source[which], rows.size_px[which])


def _of(rng: np.random.Generator, spoil: Callable[[Rows, np.random.Generator], Rows]) -> Brought:
    """One drone or two."""
    return spoiled(rng, drones(rng, int(rng.choice([1, 1, 2]))), spoil, all_share=0.4)


def _twice(rng: np.random.Generator, *, count: int, lost: float, late_s: float) -> Brought:
    """One camera's stream registered under another's name too, some rows lost on the way, some time late."""
    simulated = simulate(scenery.usual(rng, count))
    one, two = rng.choice([camera.id for camera in simulated.scene.cameras], 2, replace=False).tolist()
    rows = simulated.rows[one]
    keep = rng.random(len(rows.track)) >= lost
    t_unix_ns = rows.t_unix_ns[keep] + round(late_s * 1e9)
    late = Rows(t_unix_ns, rows.pixels[keep], rows.track[keep], rows.source[keep], rows.size_px[keep])
    return Brought(with_rows(simulated, {two: late}), (Fault(Cause.TRACKS, (one, two)),), f"{two} is {one}")


UNSEEN: Final = (
    Kind("constant_3pc", partial(_of, spoil=partial(_constant, share=0.03))),
    Kind("constant_20pc", partial(_of, spoil=partial(_constant, share=0.2))),
    Kind("constant_50pc", partial(_of, spoil=partial(_constant, share=0.5))),
    Kind("constant_whole_px", partial(_of, spoil=partial(_constant, share=0.15, whole_px=True))),
    Kind("held_15pc", partial(_of, spoil=partial(_held, share=0.15, decimals=6))),
    Kind("held_40pc", partial(_of, spoil=partial(_held, share=0.4, decimals=2))),
    Kind("held_whole_px", partial(_of, spoil=partial(_held, share=0.2, decimals=0))),
    Kind("frozen_and_back", partial(_of, spoil=partial(_frozen, back=True))),
    Kind("frozen_for_good", partial(_of, spoil=partial(_frozen, back=False))),
    Kind("twice_of_3", partial(_twice, count=3, lost=0.0, late_s=0.0)),
    Kind("twice_of_4_lossy", partial(_twice, count=4, lost=0.15, late_s=0.04)),
)
