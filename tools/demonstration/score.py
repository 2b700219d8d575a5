"""The demo's verdict: what came over MAVLink against where the objects truly were."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.geodesy import Origin, ecef_to_enu
from calib.simulation.flight import ObjectFlight
from edge.common.arrays import Array
from tools.doubles.listener import LOST, Position

PASS_M: Final = 1.0  # m RMSE: what the demo promises
NOBODYS_M: Final = 10.0  # m: a track whose median is farther from every object follows none of them


@dataclass(frozen=True)
class ObjectScore:
    """How well one object was followed. tracks: the numbers it had; first_s: seconds from the start to its first."""

    name: str
    positions: int
    tracks: tuple[int, ...]
    rmse_m: float
    median_m: float
    maximum_m: float
    first_s: float
    seen_s: float


@dataclass(frozen=True)
class Score:
    """The whole demo. latency_ms: median and 99th percentile from exposure to MAVLink received."""

    objects: tuple[ObjectScore, ...]
    nobodys: tuple[int, ...]
    latency_ms: tuple[float, float] | None

    @property
    def passed(self) -> bool:
        """Whether the first object was found and followed within PASS_M."""
        return bool(self.objects) and self.objects[0].positions > 0 and self.objects[0].rmse_m <= PASS_M


def errors_m(
    positions: Sequence[Position], flights: Sequence[ObjectFlight], start_unix_ns: int, origin: Origin
) -> Array:
    """(N, objects) distance of each position from each object at the position's own time; inf where it did not fly."""
    enu = ecef_to_enu(np.array([position.ecef_m for position in positions], float).reshape(-1, 3), origin)
    t_s = np.array([position.time_ns - start_unix_ns for position in positions]) * 1e-9
    distances = [np.linalg.norm(enu - flight.position_enu(t_s), axis=1) for flight in flights]
    return np.asarray(np.nan_to_num(np.column_stack(distances), nan=np.inf))


def score(positions: Sequence[Position], flights: Sequence[ObjectFlight], start_unix_ns: int, origin: Origin) -> Score:
    """Give every track to the object it was nearest to for most of its life, and measure.

    A track is scored whole: that it was wrong for a while counts against the object it follows.
    """
    positions = [position for position in positions if position.state != LOST]
    if not positions:
        return Score((), (), None)
    error = errors_m(positions, flights, start_unix_ns, origin)
    track, owner = _owners(positions, error)
    scores = []
    for k, flight in enumerate(flights):
        rows = np.array([owner[number] == k for number in track.tolist()])
        scores.append(_object(flight, positions, error[:, k], rows, start_unix_ns))
    nobodys = tuple(number for number, k in owner.items() if k is None)
    return Score(tuple(scores), nobodys, _latency_ms(positions))


def followed_m(positions: Sequence[Position], error: Array) -> Array:
    """(N,) distance of each position from the object its track follows; from the nearest one where it follows none.

    error: (N, objects) m, of `errors_m`. A track whose object has landed is infinitely far from it, however near
    another flies.
    """
    track, owners = _owners(positions, error)
    found: Array = error.min(axis=1, initial=np.inf)
    for number, owner in owners.items():
        if owner is not None:
            found[track == number] = error[track == number, owner]
    return found


def _owners(positions: Sequence[Position], error: Array) -> tuple[NDArray[np.int64], dict[int, int | None]]:
    """The track (N,) of each position, and the object that each track follows."""
    track = np.array([position.track for position in positions], np.int64)
    return track, {number: _owner(error[track == number]) for number in np.unique(track).tolist()}


def _owner(error: Array) -> int | None:
    """The object a track follows, from its errors (N, objects); None if it is near none."""
    # A bird that has landed counts as far away, not as unknown.
    median = np.median(np.minimum(error, 1e6), axis=0)
    return int(median.argmin()) if median.min() < NOBODYS_M else None


def _object(
    flight: ObjectFlight, positions: Sequence[Position], error: Array, rows: Array, start_unix_ns: int
) -> ObjectScore:
    own = [position for position, mine in zip(positions, rows, strict=True) if mine]
    found = error[rows.astype(bool) & np.isfinite(error)]
    times = np.array([position.time_ns for position in own], np.int64)
    return ObjectScore(
        name=flight.object.name,
        positions=len(own),
        tracks=tuple(dict.fromkeys(position.track for position in own)),
        rmse_m=float(np.sqrt(np.mean(found**2))) if len(found) else float("nan"),
        median_m=float(np.median(found)) if len(found) else float("nan"),
        maximum_m=float(found.max()) if len(found) else float("nan"),
        first_s=(own[0].received_ns - start_unix_ns) * 1e-9 if own else float("nan"),
        seen_s=len(np.unique(times // 100_000_000)) / 10,
    )


def _latency_ms(positions: Sequence[Position]) -> tuple[float, float]:
    """From the exposure of the last frame used to the datagram received."""
    delays = [(p.received_ns - (p.time_ns - p.age_ns)) * 1e-6 for p in positions if p.age_ns < 50_000_000]
    median, late = np.percentile(delays or [np.nan], [50, 99])
    return float(median), float(late)
