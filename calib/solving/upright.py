"""Which way is up: whether a network stands on its feet.

The hazard is the world turned over. Cameras that stand in a plane see the same flight above it and, with two tripods
exchanged or the pictures mirrored, below it: residuals, survey and sigma are as good. But nobody puts up tripods upside
down, so down in the picture is down in the world for most of them; and what flies is not below the lowest of them.
Cameras under a ceiling or on a cliff are such a world: one of them has to say where up is (`up_cam`), and decides.
"""

from collections.abc import Iterable
from typing import Final

import numpy as np

from edge.common.arrays import Array

DECIDES: Final = 0.25  # sine of 15 degrees: a picture whose down is nearer to the horizon than that says nothing


def upside_down(attitudes: Iterable[Array], centres_enu: Array, flown_enu: Array) -> bool:
    """Whether most cameras hang head down, or all that was flown lies below all of them.

    attitudes: R_cam_enu (3, 3) of all cameras. centres_enu: (C, 3). flown_enu: (N, 3).
    """
    downs = np.array([R[1, 2] for R in attitudes])  # how far up the picture's down points
    deciding = downs[np.abs(downs) > DECIDES]
    if int((deciding > 0).sum()) > int((deciding < 0).sum()):
        return True
    return len(flown_enu) > 0 and float(np.percentile(flown_enu[:, 2], 95)) < float(centres_enu[:, 2].min())
