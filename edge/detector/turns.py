"""Whose turn it is where more places move than can be looked at: none waits for ever.

The hazard is the ninth object. A budget that goes to the strongest goes to the same ones frame after frame, and whoever
comes last is never looked at, which nothing says. So places that were looked at a moment ago give way to those that
were not, and those that wait too long are counted.
"""

from itertools import zip_longest
from typing import Final

import numpy as np

from edge.common.arrays import Array

PLACE_PX: Final = 32.0  # px: what is nearer than this is one place
FOLLOWED_UP_NS: Final = 300_000_000  # ns for which a place where something was found goes before others
PRESSED_NS: Final = 150_000_000  # ns of waiting from which on more places are looked at in a frame
TURN_LATE_NS: Final = 500_000_000  # ns after which a place that waits is counted

MOST_FOUND: Final = 1000  # places with finds that are remembered, before old ones are forgotten

Place = tuple[int, int]


class Turns:
    """Remembers when each place of a picture was looked at, and since when others wait."""

    def __init__(self) -> None:
        self._looked: dict[Place, int] = {}
        self._waiting: dict[Place, int] = {}
        self._found: dict[Place, int] = {}
        self.late = 0

    def order(self, regions: Array, t_unix_ns: int) -> Array:
        """Regions `(N, 3)` in the order in which they are to be looked at: who waited longest, then as they come."""
        places = _places(regions)
        since = [t_unix_ns - self._looked.get(place, -TURN_LATE_NS) for place in places]
        found = [0 <= t_unix_ns - self._found.get(place, t_unix_ns + 1) < FOLLOWED_UP_NS for place in places]
        waited = sorted(range(len(since)), key=lambda k: (-min(since[k], TURN_LATE_NS), k))
        again, others = [k for k in waited if found[k]], [k for k in waited if not found[k]]
        index = [k for pair in zip_longest(again, others) for k in pair if k is not None]
        return regions[np.array(index, dtype=np.intp)]

    def pressed(self, t_unix_ns: int) -> bool:
        """Whether a place has been waiting so long that more have to be looked at."""
        return any(t_unix_ns - since > PRESSED_NS for since in self._waiting.values())

    def find(self, centre_px: Array, t_unix_ns: int) -> None:
        """Note where something was found: it is looked at again in the next frames, for one look tells nothing."""
        for place in _places(centre_px):
            if t_unix_ns - self._found.get(place, 0) > FOLLOWED_UP_NS + TURN_LATE_NS:
                self._found[place] = t_unix_ns
        if len(self._found) > MOST_FOUND:
            self._found = {place: t for place, t in self._found.items() if t_unix_ns - t < 2 * TURN_LATE_NS}

    def look(self, regions: Array, seen: int, t_unix_ns: int) -> None:
        """Note that the first `seen` regions of an order were looked at, and that the others wait."""
        places = _places(regions)
        for place in places[:seen]:
            self._looked[place] = t_unix_ns
            self._waiting.pop(place, None)
        self._waiting = {place: self._waiting.get(place, t_unix_ns) for place in places[seen:]}
        self.late += sum(t_unix_ns - since > TURN_LATE_NS for since in self._waiting.values())
        if len(self._looked) > 10 * max(1, len(places)):
            self._looked = {place: t for place, t in self._looked.items() if t_unix_ns - t < TURN_LATE_NS}


def _places(regions: Array) -> list[Place]:
    cells = np.floor(regions[:, :2] / PLACE_PX).astype(int)
    return [(int(u), int(v)) for u, v in cells]
