"""No site is larger than its cameras can see: which position cannot be of this site, and what was meant by it.

The hazard is the typing error that stays a place on the Earth: latitude and longitude exchanged, a sign left out. Such
a camera stands in another country, and everything that is computed with it is exact and wrong. Cameras that watch one
object stand kilometres apart at most, and by far the most are right; whoever is far from them is not believed.
"""

from typing import Final

import numpy as np

from calib.geodesy import Origin, enu_to_ecef
from calib.station.config import MIN_CAMERAS
from edge.common.arrays import Array

LARGEST_SITE_M: Final = 50e3  # across: ten times what cameras that see a common object are apart
CORRECT_IT: Final = "write latitude first, then longitude, both with their signs, and correct the position"


def too_far(places: dict[str, Origin]) -> dict[str, str]:
    """Why a camera's position cannot be of this site, by camera; places: latitude deg, longitude deg, height m.

    Where no more than half of the cameras stand together, it may be any of them.
    """
    names = sorted(places)
    apart = _apart_m([places[name] for name in names])
    near = (apart <= LARGEST_SITE_M).sum(axis=1)
    if len(names) == 0 or near.min() == len(names):
        return {}
    core = int(np.argmax(near))
    others = [name for k, name in enumerate(names) if apart[core, k] <= LARGEST_SITE_M]
    if 2 * len(others) <= len(names):
        far_m = apart.max()
        return dict.fromkeys(names, f"its position is up to {far_m / 1e3:.0f} km from the other cameras'")
    return {
        name: f"its position is {apart[core, k] / 1e3:.0f} km from the other cameras'{_meant(places, name, others)}"
        for k, name in enumerate(names)
        if name not in others
    }


def all_in_one_place(places: dict[str, Origin]) -> bool:
    """Whether several cameras were given the very same position: a file that was copied and never filled in."""
    return len(places) >= MIN_CAMERAS and len(set(places.values())) == 1


def exchanged(places: dict[str, Origin], origin: Origin) -> bool:
    """Whether all positions are far from the origin, and all near with latitude and longitude exchanged."""
    if not places or any(abs(longitude) > 90 for _, longitude, _ in places.values()):
        return False
    as_given, turned = (
        _apart_m([origin, *(_turned(place) if turn else place for place in places.values())])[0, 1:]
        for turn in (False, True)
    )
    return bool(np.all(as_given > LARGEST_SITE_M) and np.all(turned <= LARGEST_SITE_M))


def _meant(places: dict[str, Origin], name: str, others: list[str]) -> str:
    """What would bring it there."""
    latitude, longitude, height = places[name]
    guesses = [
        (latitude, -longitude, height, "the sign of its longitude"),
        (-latitude, longitude, height, "the sign of its latitude"),
    ]
    guesses = [(longitude, latitude, height, "the order of latitude and longitude"), *guesses]
    for *place, slip in guesses:
        if (
            abs(place[0]) <= 90
            and _apart_m([places[others[0]], (place[0], place[1], place[2])])[0, 1] <= LARGEST_SITE_M
        ):
            return f": {slip} is wrong"
    return ""


def _turned(place: Origin) -> Origin:
    return place[1], place[0], place[2]


def _apart_m(places: list[Origin]) -> Array:
    """(N, N) straight distances."""
    ecef = np.array([enu_to_ecef(np.zeros(3), place)[0] for place in places]).reshape(-1, 3)
    apart: Array = np.linalg.norm(ecef[:, None] - ecef[None], axis=2)
    return apart
