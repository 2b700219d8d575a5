"""Which cameras should see a target that others report, and do not, though they see other things: negative information.

Two rays are two rays. The hazard is the liar's range: of an object that one honest camera sees, a second one may say
any ray that crosses the first, and the two meet well. Only a third camera tells, by what it does not see. It must be an
honest witness itself, so it counts only where it could have seen the object: no lower in its picture than it has seen
things thereabouts (roofs, trees and masks of roads lie below), as large as in the others' pictures, and while it sees
something else.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.network import Camera
from edge.common.arrays import Array

PICTURE_COLUMNS: Final = 32  # of a picture's parts: coarser, and what flies low behind a roof was seen "there" above it
PICTURE_ROWS: Final = 18
SMALLER: Final = 0.67  # of the size in the smallest of the others' pictures: a target as small as that may be missed
DENIED_S: Final = 2.0  # s without a detection: longer than any flicker
DENIED_FRAMES: Final = 10  # likewise
SEES_OTHERS_S: Final = 2.0  # s: how lately a camera that denies one target must have seen another
MOST_OUTVOTED: Final = 2  # cameras: of three that agree, two are honest, and two rays of theirs are the position
LEAST_AWAY_M: Final = 1.0  # m: nearer than any target
NEVER: Final = -np.inf


class Denials:
    """Of targets (N,) and cameras (C,): frames missed in a row, and since when; where each camera has seen things.

    against: (N, C) which cameras speak against which targets, as last weighed.
    """

    def __init__(self, cameras: Sequence[Camera]) -> None:
        count = len(cameras)
        self._centres = np.array([camera.centre_enu for camera in cameras]).reshape(count, 3)
        self._focal_px = np.array([min(camera.lens.intrinsics[:2]) for camera in cameras])
        self._ids = [camera.id for camera in cameras]
        self._open: dict[str, NDArray[np.bool_]] = {}  # by name: parts of its picture where it can see
        self._missed: Array = np.zeros((0, count))
        self._since_s: Array = np.zeros((0, count))
        self._seen_s: Array = np.zeros((0, count))
        self.against: NDArray[np.bool_] = np.zeros((0, count), bool)

    def add(self) -> None:
        """One target more."""
        count = len(self._ids)
        self._missed = np.vstack([self._missed, np.zeros(count)])
        self._since_s = np.vstack([self._since_s, np.zeros(count)])
        self._seen_s = np.vstack([self._seen_s, np.full(count, NEVER)])
        self.against = np.vstack([self.against, np.zeros(count, bool)])

    def keep(self, which: NDArray[np.bool_]) -> None:
        """Forget all targets but those of a mask (N,)."""
        for name in ("_missed", "_since_s", "_seen_s", "against"):
            setattr(self, name, getattr(self, name)[which])

    def exchange(self, cameras: Sequence[Camera], kept: list[int], shift_s: float) -> None:
        """Another network: camera k of it was number kept[k], or -1 if it is new; times move by shift_s."""
        fresh, known = Denials(cameras), np.array(kept)
        fresh._open = self._open
        last = np.maximum(known, 0)
        fresh._missed = np.where(known >= 0, self._missed[:, last], 0)
        fresh._since_s = np.where(known >= 0, self._since_s[:, last] + shift_s, 0.0)
        fresh._seen_s = np.where(known >= 0, self._seen_s[:, last] + shift_s, NEVER)
        fresh.against = (known >= 0) & self.against[:, last]
        self.__dict__.update(fresh.__dict__)

    def forget(self, camera: int) -> None:
        """What this camera saw and did not see counts no more, nor where: it may look elsewhere."""
        self._open.pop(self._ids[camera], None)
        self._missed[:, camera], self._seen_s[:, camera], self.against[:, camera] = 0, NEVER, False

    def hit(self, camera: int, which: NDArray[np.intp], pixels: Array, size_px: tuple[int, int], t_s: float) -> None:
        """A camera saw confirmed targets (K,) at pixels (K, 2)."""
        self._missed[which, camera] = 0
        self._seen_s[which, camera] = t_s
        sees = self._open.setdefault(self._ids[camera], np.zeros((PICTURE_ROWS, PICTURE_COLUMNS), bool))
        for row, column in zip(*_part(pixels, size_px), strict=True):
            sees[: row + 1, column] = True

    def miss(self, camera: int, which: NDArray[np.intp], pixels: Array, size_px: tuple[int, int], t_s: float) -> None:
        """A camera should have seen targets (K,) at pixels (K, 2), and did not."""
        parts = self._open.get(self._ids[camera])
        if parts is None:
            return
        which = which[parts[_part(pixels, size_px)]]
        first = self._missed[which, camera] == 0
        self._since_s[which[first], camera] = t_s
        self._missed[which, camera] += 1

    def weigh(self, positions_enu: Array, watching: NDArray[np.bool_], now_s: float) -> None:
        """Who speaks against targets at positions (N, 3). watching: (N, C) which cameras have just seen them."""
        size = self._focal_px / np.maximum(np.linalg.norm(positions_enu[:, None] - self._centres, axis=2), LEAST_AWAY_M)
        smallest = np.where(watching, size, np.inf).min(axis=1, initial=np.inf)
        long = (self._missed >= DENIED_FRAMES) & (now_s - self._since_s >= DENIED_S)
        sees_others = self._seen_s.max(axis=0, initial=NEVER) > now_s - SEES_OTHERS_S
        self.against = long & ~watching & sees_others & (size >= SMALLER * smallest[:, None])

    def outvoted(self, watching: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(N,) targets on the word of two cameras, one of which may lie, that two others or more speak against."""
        outvoted: NDArray[np.bool_] = (watching.sum(axis=1) <= MOST_OUTVOTED) & (self.against.sum(axis=1) >= 2)
        return outvoted


def _part(pixels: Array, size_px: tuple[int, int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    width, height = size_px
    row = np.clip(pixels[:, 1] / height * PICTURE_ROWS, 0, PICTURE_ROWS - 1).astype(np.intp)
    column = np.clip(pixels[:, 0] / width * PICTURE_COLUMNS, 0, PICTURE_COLUMNS - 1).astype(np.intp)
    return row, column
