"""Which reference frame positions are in, and what it adds to their sigma on the Earth not to know it.

The hazard is the position that is right to a centimetre in a frame that nobody named. Receivers give coordinates in the
frame of whoever sends the corrections, and the realisations in use lie up to a metre apart. It moves all cameras of a
site alike: so it belongs to every position that leaves the site, and to none that the site is adjusted or tracked with.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

UNKNOWN_FRAME_SIGMA_M: Final = 1.0  # along each axis: the realisations in use differ by up to that
UNKNOWN_LABEL: Final = "unknown"
# Labels that name no realisation: coordinates that carry them are known to a metre or two.
UNKNOWN_LABELS: Final = frozenset({"", UNKNOWN_LABEL, "wgs84", "wgs 84", "epsg:4979", "epsg:4326"})


@dataclass(frozen=True)
class ReferenceFrame:
    """The frame of coordinates, by its label. conversion_sigma_m: of the operation that brought them into it."""

    label: str = UNKNOWN_LABEL
    conversion_sigma_m: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the label says which realisation it is."""
        return self.label.strip().lower() not in UNKNOWN_LABELS

    @property
    def sigma_m(self) -> float:
        """One sigma along each axis that all positions in this frame share, in WGS 84."""
        return math.hypot(self.conversion_sigma_m, 0.0 if self.known else UNKNOWN_FRAME_SIGMA_M)


def frame_of_all(frames: Collection[ReferenceFrame]) -> ReferenceFrame:
    """The frame of a site by those of its cameras: the least known of them; unknown where there is none."""
    return max(frames, key=lambda frame: frame.sigma_m, default=ReferenceFrame())
