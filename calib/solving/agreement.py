"""Where in time two cameras' tracks can be one object: their misfit on a common grid of instants, and what it says.

The hazard is the sum. Two tracks that agree for half of their time and contradict each other for the rest are not
"mostly one object": somewhere one of them went over to another one. So the misfit is kept as a function of time, and a
contradiction counts where somebody else explains it: an inaccurate lens has no rival, an exchanged number always has.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.geometry.twoview import reprojection, triangulate
from calib.solving.scaffold import Pose
from calib.solving.series import TrackSeries
from edge.common.arrays import Array

AGREEMENT_STEP_S: Final = 0.1  # of the grid: frames of a slow camera
MOST_INSTANTS: Final = 6000  # of a long flight the grid is coarser
FEW_INSTANTS: Final = 1000  # enough where each camera sees one thing at a time
WINDOW: Final = 11  # instants, in which a state must be that of
MOST_OF_WINDOW: Final = 0.8  # of them, at least
FEWEST_VALID: Final = 5  # of them, to be any
OUT: Final = 2.5  # times the threshold: no inaccuracy of a pose any more
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Gridded:
    """A track read at the grid's instants: rays (G, 2), NaN where it is not seen."""

    camera: str
    track: TrackSeries
    rays: Array

    @property
    def seen(self) -> Bools:
        """(G,) where it is read."""
        seen: Bools = np.isfinite(self.rays[:, 0])
        return seen


@dataclass(frozen=True)
class TrackPair:
    """Two cameras' tracks. misfit (G,) in ray units, NaN where not both are seen; agree, differ (G,) for a while."""

    misfit: Array
    agree: Bools
    differ: Bools

    def within(self, mask: Bools) -> "TrackPair":
        """Only at some of the instants."""
        return TrackPair(np.where(mask, self.misfit, np.nan), self.agree & mask, self.differ & mask)


def grid_of(tracks: dict[str, list[TrackSeries]], offsets: dict[str, float]) -> Array:
    """(G,) site times from the first row to the last."""
    begin = min(own[k].t_s[0] + offsets[name] for name, own in tracks.items() for k in range(len(own)))
    end = max(own[k].t_s[-1] + offsets[name] for name, own in tracks.items() for k in range(len(own)))
    most = MOST_INSTANTS if any(map(several_at_once, tracks.values())) else FEW_INSTANTS
    return np.arange(begin, end, max(AGREEMENT_STEP_S, (end - begin) / most))


def several_at_once(tracks: list[TrackSeries]) -> bool:
    """Whether a camera follows more than one thing at a time."""
    spans = sorted((float(track.t_s[0]), float(track.t_s[-1])) for track in tracks)
    last = -np.inf
    for begin, end in spans:
        if begin < last:
            return True
        last = max(last, end)
    return False


def on_grid(name: str, tracks: list[TrackSeries], grid_s: Array, offset_s: float) -> list[Gridded]:
    """A camera's tracks at the grid's instants."""
    return [Gridded(name, track, track.at(grid_s - offset_s)) for track in tracks]


def compared(one: Gridded, two: Gridded, poses: dict[str, Pose], threshold_ray: float) -> TrackPair | None:
    """The misfit of two tracks over time; None if they are never seen at once."""
    both = one.seen & two.seen
    if both.sum() < FEWEST_VALID:
        return None
    p, q = poses[one.camera], poses[two.camera]
    rays1, rays2 = one.rays[both], two.rays[both]
    points = triangulate([rays1, rays2], [p.R, q.R], [p.centre, q.centre])
    misfit = np.full(len(both), np.nan)
    misfit[both] = np.maximum(reprojection(points, rays1, p.R, p.centre), reprojection(points, rays2, q.R, q.centre))
    with np.errstate(invalid="ignore"):
        agree, differ = misfit < threshold_ray, misfit > OUT * threshold_ray
    return TrackPair(misfit, _lasting(agree, both), _lasting(differ, both))


def _lasting(true: Bools, valid: Bools) -> Bools:
    """(G,) where something holds for most of a while around."""
    window = np.ones(WINDOW)
    held, known = (np.convolve(values.astype(float), window, "same") for values in (true & valid, valid))
    lasting: Bools = valid & (known >= FEWEST_VALID) & (held >= MOST_OF_WINDOW * known)
    return lasting


def contested(pairs: dict[tuple[int, int], TrackPair]) -> dict[tuple[int, int], Bools]:
    """(G,) by pair of two cameras: where it differs, and one of the two agrees with another track of that camera."""
    length = len(next(iter(pairs.values())).misfit) if pairs else 0
    first: dict[int, NDArray[np.int64]] = {}
    second: dict[int, NDArray[np.int64]] = {}
    for (i, j), pair in pairs.items():
        first[i] = first.get(i, np.zeros(length, np.int64)) + pair.agree
        second[j] = second.get(j, np.zeros(length, np.int64)) + pair.agree
    return {(i, j): pair.differ & ((first[i] > 0) | (second[j] > 0)) for (i, j), pair in pairs.items()}
