"""How wrong each camera's pixels really are, learnt while they are used: how much they scatter, and how much stays.

The hazard is the detector that is worse than it says. If its scatter is twice what it claims, sigma is half of what it
should be; and if its boxes sit off the object's middle, or its lens is wrong where the object is, thirty rows a second
say the same wrong thing, and a filter that counts them all is sure of a wrong place. The two show apart. Scatter shows
in what four pixels in a row are off a parabola, whatever the filter thinks; what stays shows in innovations that agree
with the mean of those before, as those of a true filter do not (Mehra 1970). What is learnt widens what a camera
claims, and never narrows it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

LEARNT_OVER_S: Final = 10.0  # s of looks at targets that count
DOUBT_S: Final = 1.0  # s of looks that speak for what is claimed, before any
MEAN_OVER_S: Final = 1.0  # s over which the mean of the last innovations is taken
LOOKS_APART_S: Final = 0.5  # s between two looks: longer ones are not compared
ROW: Final = 4  # pixels in a row: any parabola fits three
ROW_S: Final = 0.4  # s that a row may last: a turn is no parabola for longer
LEAST_APART_S: Final = 1e-3  # s between two pixels of a row; no camera is faster, stamps that say so are wrong
OUTLIER: Final = 12.0  # variances that one row counts at most: 5 true ones in 10 000 have more
MOST_WHITE: Final = 25.0  # times the claimed variance: beyond, the camera is the guard's business
MOST_LASTING_PX: Final = 20.0  # px, one sigma, likewise
LEAST_WATCHING: Final = 3  # cameras: two always agree about a point, but for one direction


@dataclass(frozen=True)
class Looks:
    """One camera's pixels (K, 2) of targets, px; innovations (K, 2), px; variances (K,), px2; who else looks (K,).

    claimed: of the scatter; by_pose: that the network's own uncertainty makes stay.
    """

    pixels: Array
    innovation_px: Array
    claimed_px2: Array
    by_pose_px2: Array
    watching: NDArray[np.intp]


class PixelErrors:
    """Learnt of each of C cameras, from N targets."""

    def __init__(self, cameras: int) -> None:
        self._white, self._white_s = np.ones(cameras), np.full(cameras, DOUBT_S)
        self._lasting_px2, self._lasting_s = np.zeros(cameras), np.full(cameras, DOUBT_S)
        self._pixels = np.zeros((0, cameras, ROW, 2))
        self._times_s = np.zeros((0, cameras, ROW))
        self._mean_px = np.zeros((0, cameras, 2))
        self._long_s = np.zeros((0, cameras))

    @property
    def white(self) -> Array:
        """(C,) variance of the scatter against what is claimed, 1 at least."""
        return np.asarray(np.clip(self._white, 1.0, MOST_WHITE), float)

    @property
    def lasting_px(self) -> Array:
        """(C,) one sigma of what stays, beyond what the network says.

        Never less than all cameras' mean: which of them is wrong, their innovations tell badly. Whoever is believed
        more draws the target to itself, and looks the better for it.
        """
        own_px2 = np.maximum(self._lasting_px2, 0.0)
        return np.asarray(np.minimum(np.sqrt(np.maximum(own_px2, own_px2.mean())), MOST_LASTING_PX), float)

    def add(self) -> None:
        """One target more."""
        cameras = len(self._white)
        self._pixels = np.concatenate([self._pixels, np.zeros((1, cameras, ROW, 2))])
        self._times_s = np.concatenate([self._times_s, np.full((1, cameras, ROW), -np.inf)])
        self._mean_px = np.concatenate([self._mean_px, np.zeros((1, cameras, 2))])
        self._long_s = np.vstack([self._long_s, np.zeros(cameras)])

    def keep(self, which: NDArray[np.bool_]) -> None:
        """Forget all targets but those of a mask (N,); what was learnt of the cameras stays."""
        for name in ("_pixels", "_times_s", "_mean_px", "_long_s"):
            setattr(self, name, getattr(self, name)[which])

    def exchange(self, kept: list[int]) -> None:
        """Another network: camera k of it was number kept[k], or -1 if it is new. Rows begin anew."""
        targets, fresh = len(self._pixels), PixelErrors(len(kept))
        for new, old in enumerate(kept):
            if old >= 0:
                fresh._white[new], fresh._white_s[new] = self._white[old], self._white_s[old]
                fresh._lasting_px2[new], fresh._lasting_s[new] = self._lasting_px2[old], self._lasting_s[old]
        self.__dict__.update(fresh.__dict__)
        for _ in range(targets):
            self.add()

    def learn(self, camera: int, which: NDArray[np.intp], t_s: float, looks: Looks) -> None:
        """Take a camera's looks at targets `which` (K,), of one frame."""
        after_s = t_s - self._times_s[which, camera, -1]
        self._learn_lasting(camera, which, after_s, looks)
        forward = which[after_s > 0]
        self._pixels[forward, camera, :-1] = self._pixels[forward, camera, 1:]
        self._times_s[forward, camera, :-1] = self._times_s[forward, camera, 1:]
        self._pixels[forward, camera, -1], self._times_s[forward, camera, -1] = looks.pixels[after_s > 0], t_s
        self._learn_white(camera, which[after_s > 0], looks.claimed_px2[after_s > 0])

    def _learn_white(self, camera: int, which: NDArray[np.intp], claimed_px2: Array) -> None:
        """How far rows of four pixels are off any parabola: their third divided difference (Newton)."""
        t_s = self._times_s[which, camera] - self._times_s[which, camera, -1:]
        even = t_s[:, 0] > -ROW_S
        even[even] = np.diff(t_s[even], axis=1).min(axis=1, initial=ROW_S) > LEAST_APART_S
        if not even.any():
            return
        t_s, rows = t_s[even], self._pixels[which[even], camera]
        apart = t_s[:, :, None] - t_s[:, None, :] + np.eye(ROW)
        weights = 1 / np.prod(apart, axis=2)
        off_px = np.einsum("kr,krx->kx", weights, rows)
        variances = np.sum(off_px**2, axis=1) / 2 / np.sum(weights**2, axis=1) / claimed_px2[even]
        # Each pixel is in four rows: their sum is worth that of a fourth.
        span_s = float(-t_s[:, 2].sum())
        self._white_s[camera] = min(self._white_s[camera] + span_s, LEARNT_OVER_S)
        share = span_s / self._white_s[camera]
        self._white[camera] += share * (float(np.minimum(variances, OUTLIER).mean()) - self._white[camera])

    def _learn_lasting(self, camera: int, which: NDArray[np.intp], after_s: Array, looks: Looks) -> None:
        again = (after_s > 0) & (after_s < LOOKS_APART_S)
        told = again & (looks.watching >= LEAST_WATCHING)
        if told.any():
            stays_px2 = np.sum(looks.innovation_px[told] * self._mean_px[which[told], camera], axis=1) / 2
            # Of its own error an innovation keeps what the target's three coordinates do not take up.
            left = (1 - 3 / (2 * looks.watching[told])) ** 2
            beyond_px2 = stays_px2 / left - looks.by_pose_px2[told]
            self._lasting_s[camera] = min(self._lasting_s[camera] + after_s[told].sum(), LEARNT_OVER_S)
            share = after_s[told].sum() / self._lasting_s[camera]
            self._lasting_px2[camera] += share * (float(beyond_px2.mean()) - self._lasting_px2[camera])
        # The plain mean of a young row, so that what stays shows at once; later one that forgets.
        long_s = np.where(again, np.minimum(self._long_s[which, camera] + after_s, MEAN_OVER_S), 1.0)
        slow = np.where(again, after_s / long_s, after_s > 0)[:, None]
        self._mean_px[which, camera] += slow * (looks.innovation_px - self._mean_px[which, camera])
        self._long_s[which, camera] = np.where(again, long_s, 0.0)
