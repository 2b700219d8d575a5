"""The one table of kinds, and the scene with a number: the same split and number give the same scene."""

from typing import Final, Literal
from zlib import crc32

import numpy as np

from tools.doubles.hazards.brought import Brought
from tools.doubles.hazards.clock_faults import CLOCKS
from tools.doubles.hazards.healthy import HEALTHY
from tools.doubles.hazards.lens_faults import LENSES
from tools.doubles.hazards.number_faults import NUMBERS
from tools.doubles.hazards.pose_faults import POSES
from tools.doubles.hazards.survey_faults import EXCHANGED, MISTAKEN
from tools.doubles.hazards.table import Kind
from tools.doubles.hazards.track_faults import TRACKS
from tools.doubles.hazards.unseen_faults import UNSEEN
from tools.doubles.hazards.weak_geometry import WEAK

ALL: Final = (*HEALTHY, *EXCHANGED, *MISTAKEN, *LENSES, *WEAK, *TRACKS, *NUMBERS, *UNSEEN, *CLOCKS, *POSES)
KINDS: Final[dict[str, Kind]] = {kind.name: kind for kind in ALL}
HEALTHY_SHARE: Final = 3  # every third scene has nothing wrong in it

# `choose` is for developing on; `report` is looked at once, at the end.
Split = Literal["choose", "report"]


def draw(kind: str, split: Split, seed: int, number: int) -> Brought:
    """Scene `number` of a kind."""
    entropy = (crc32(split.encode()), seed, crc32(kind.encode()), number)
    return KINDS[kind].draw(np.random.default_rng(np.random.SeedSequence(entropy)))


def planned(kinds: list[str], count: int) -> list[tuple[str, int]]:
    """`count` scenes as (kind, number): every third a healthy one where there are such, the kinds taking turns."""
    healthy = [name for name in kinds if KINDS[name].healthy]
    others = [name for name in kinds if not KINDS[name].healthy]
    made = dict.fromkeys(kinds, 0)
    plan = []
    for at in range(count):
        pool = healthy if healthy and (at % HEALTHY_SHARE == 0 or not others) else others
        name = min(pool, key=lambda each: made[each])
        plan.append((name, made[name]))
        made[name] += 1
    return plan
