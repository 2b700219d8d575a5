"""The way from one place of rest to the next: whether the antenna was seen to go it, or is elsewhere all at once.

The hazard is to take a jump for a walk. A tripod that is carried passes every metre in between, fixed all the time; a
base that a caster exchanges, or ambiguities that are fixed anew, put the position elsewhere from one epoch to the next.
The first is explained, and what was averaged before is of another place; of the second one of the two places is false.
"""

import itertools
import math
from typing import Final

from edge.gnss.gates import Position, elapsed_ms, offset_m

LONGEST_STEP: Final = 0.3  # of the whole way, between two epochs: a carried tripod is seen at several places on it
LEAST_STEPS: Final = 5
MOST_POSITIONS: Final = 12_000  # ten minutes at 20 Hz; a longer way has no beginning that is remembered
LONGEST_GAP_S: Final = 2.0  # between epochs on the way: what happened in a longer one was not seen


class Way:
    """Positions since the antenna was last at rest."""

    def __init__(self) -> None:
        self._places: list[Position] = []

    def begin(self, rest: Position) -> None:
        """It is at rest here."""
        self._places = [rest]

    def add(self, position: Position) -> None:
        """It is here, by a fixed solution."""
        if self._places and len(self._places) < MOST_POSITIONS:
            self._places.append(position)

    def carried_m(self, arrived: Position) -> float:
        """How far it was carried, if it was seen on its way until `arrived`; 0 where it was not, or did not move."""
        places = self._until(arrived)
        if len(places) <= LEAST_STEPS:
            return 0.0
        pairs = list(itertools.pairwise(places))
        steps_m = [math.hypot(*offset_m(after, before)) for before, after in pairs]
        gaps_s = [elapsed_ms(after.t_day_ms, before.t_day_ms) / 1000 for before, after in pairs]
        distance_m = math.hypot(*offset_m(arrived, places[0]))
        seen = max(steps_m) <= LONGEST_STEP * distance_m and max(gaps_s) <= LONGEST_GAP_S
        return distance_m if seen else 0.0

    def _until(self, arrived: Position) -> list[Position]:
        return self._places[: self._places.index(arrived) + 1] if arrived in self._places else []
