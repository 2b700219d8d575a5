"""What was flown, as exports want it: tracks in geodetic coordinates, cut where nothing was seen.

Two hazards. A line drawn over a gap is a flight that nobody saw: a track is therefore a list of stretches, and no
format joins them. And a height is worth nothing without its zero: Skyfix's are above the WGS 84 ellipsoid, while KML
and GPX mean heights above the sea, tens of metres off. Those are written above the sea only if the geoid's undulation
is given, and otherwise say in words that they are not.
"""

import datetime as dt
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

GAP_S: Final = 1.0  # s without a row; trajectories have 20 a second wherever two cameras see the object
NS_PER_S: Final = 1_000_000_000


@dataclass(frozen=True)
class Track:
    """One object: `(N,)` UTC ns that rise, `(N, 3)` latitude deg, longitude deg, ellipsoidal height m, `(N, 3)` sigma.

    sigma_enu_m: one sigma east, north, up in metres.
    """

    number: int
    t_unix_ns: NDArray[np.int64]
    geodetic: Array
    sigma_enu_m: Array

    def stretches(self) -> list[slice]:
        """The rows between gaps of more than GAP_S, in order."""
        cuts = np.flatnonzero(np.diff(self.t_unix_ns) > GAP_S * NS_PER_S) + 1
        return [slice(int(begin), int(end)) for begin, end in pairwise([0, *cuts, len(self.t_unix_ns)])]


@dataclass(frozen=True)
class Flown:
    """All tracks of one source. undulation_m: geoid above ellipsoid, to write heights above the sea where meant."""

    name: str
    tracks: tuple[Track, ...]
    undulation_m: float | None = None

    @property
    def heights(self) -> str:
        """What the heights of a format that means sea level are above."""
        if self.undulation_m is None:
            return "heights in metres above the WGS 84 ellipsoid, not above the sea"
        return f"heights in metres above the geoid, taken as {self.undulation_m:g} m above the WGS 84 ellipsoid"

    def sea_level_m(self, track: Track) -> Array:
        """`(N,)` heights for a format that means sea level: above the geoid, if that is known."""
        return np.asarray(track.geodetic[:, 2] - (self.undulation_m or 0.0))


def utc(t_unix_ns: int) -> str:
    """ISO 8601 in UTC, to the microsecond, which is as fine as a datetime is."""
    seconds, rest = divmod(t_unix_ns, NS_PER_S)
    moment = dt.datetime.fromtimestamp(seconds, dt.UTC) + dt.timedelta(microseconds=rest // 1000)
    return moment.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
