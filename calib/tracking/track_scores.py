"""Track scores: the sequential probability ratio test of each track, and track confirmation (Sittler 1964).

A track's score is the log-likelihood ratio of an object against clutter, summed over what was seen and what was not.
The hazard is the ghost that looks healthy: two cameras feed it faithfully with rays of two different objects, and only
the third, which sees nothing there, knows. So not seeing counts as evidence too, per camera, and a target is confirmed
only when no more cameras deny it than support it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

MEMORY: Final = 0.97  # a frame: evidence is worth half after 23 frames
SUPPORTS: Final = 0.4  # hits a frame of a camera that sees it; a detector in bad light still reaches that
DENIES: Final = 0.15  # hits a frame of a camera that should see it and does not
ENOUGH_FRAMES: Final = 5.0  # frames' worth of evidence before a camera counts
CONFIRM_SCORE: Final = 20.0  # log-likelihood ratio odds of 5e8 against chance, and 5 hits or more
CONFIRM_S: Final = 0.4  # s a target must live before it is confirmed
LONELY_S: Final = 5.0  # s, where a third camera sees nothing: time then has to refuse the ghost
TOP_SCORE: Final = 30.0  # either way: a target that comes back is taken for seen again after half a dozen hits
RETURN_SCORE: Final = -10.0  # of a target that coasts: more than one hit is worth where it is looked for by the metre
BAD_FIT: Final = 5.0  # mean squared normalised innovation; 2 is expected
LONELY_FIT: Final = 3.0
SEEN_LATELY_S: Final = 0.5
ASTRAY_S: Final = 0.25  # s: how soon after one camera another must have seen a target leave its gate
NO_LABEL: Final = -1
BY_TARGET: Final = ("confirmed", "last_s", "_initiated_s", "_score", "_fit")  # arrays (N,)
# Arrays (N, C), and what a camera has in them that knows nothing.
BY_CAMERA: Final = {"label": NO_LABEL, "_hits": 0, "_frames": 0, "_seen_s": -np.inf, "_astray_s": -np.inf}


@dataclass(frozen=True)
class AssociationEvidence:
    """Of detections taken (K,): the camera's track number, log-likelihood ratio, squared Mahalanobis distance (NIS)."""

    label: NDArray[np.int64]
    gain: Array
    mahalanobis2: Array


class TrackScores:
    """Arrays over targets (N,) and cameras (C,): hits, misses, last sightings, scores."""

    def __init__(self, cameras: int) -> None:
        self.track: list[int] = []
        self.confirmed: NDArray[np.bool_] = np.empty(0, bool)
        self.last_s: Array = np.empty(0)
        self.label: NDArray[np.int64] = np.empty((0, cameras), np.int64)
        self._initiated_s: Array = np.empty(0)
        self._score: Array = np.empty(0)
        self._fit: Array = np.empty(0)
        self._hits: Array = np.empty((0, cameras))
        self._frames: Array = np.empty((0, cameras))
        self._seen_s: Array = np.empty((0, cameras))
        self._astray_s: Array = np.empty((0, cameras))

    def add(self, track: int, t_s: float, seen_by: tuple[tuple[int, int], ...]) -> None:
        """A tentative target, initiated at t_s from cameras with their own track numbers."""
        cameras = self.label.shape[1]
        label = np.full(cameras, NO_LABEL, np.int64)
        seen_s = np.full(cameras, -np.inf)
        for camera, number in seen_by:
            label[camera], seen_s[camera] = number, t_s
        self.track.append(track)
        self.confirmed = np.append(self.confirmed, False)
        self.last_s, self._initiated_s = np.append(self.last_s, t_s), np.append(self._initiated_s, t_s)
        self._score, self._fit = np.append(self._score, 0.0), np.append(self._fit, 2.0)
        self.label = np.vstack([self.label, label])
        self._hits = np.vstack([self._hits, np.zeros(cameras)])
        self._frames = np.vstack([self._frames, np.zeros(cameras)])
        self._seen_s = np.vstack([self._seen_s, seen_s])
        self._astray_s = np.vstack([self._astray_s, np.full(cameras, -np.inf)])

    def keep(self, which: NDArray[np.bool_]) -> None:
        """Forget all targets but those of a mask (N,)."""
        self.track = [track for track, kept in zip(self.track, which, strict=True) if kept]
        for name in (*BY_TARGET, *BY_CAMERA):
            setattr(self, name, getattr(self, name)[which])

    def exchange(self, kept: list[int], shift_s: float) -> None:
        """Another network: camera k of it was number kept[k], or -1 if it is new; times move by shift_s."""
        known = np.array(kept)
        for name, empty in BY_CAMERA.items():
            old = getattr(self, name)
            setattr(self, name, np.where(known >= 0, old[:, np.maximum(known, 0)], empty).astype(old.dtype))
        for name in ("last_s", "_initiated_s", "_seen_s", "_astray_s"):
            setattr(self, name, getattr(self, name) + shift_s)

    def hit(self, camera: int, which: NDArray[np.int64], t_s: float, evidence: AssociationEvidence) -> None:
        """Camera saw targets `which` (K,) at t_s."""
        self._seen_s[which, camera] = t_s
        self.label[which, camera] = evidence.label
        self._hits[which, camera] = self._hits[which, camera] * MEMORY + 1
        self._frames[which, camera] = self._frames[which, camera] * MEMORY + 1
        self._score[which] = np.minimum(self._score[which] + evidence.gain, TOP_SCORE)
        # One detection near a target long unseen is clutter sooner than it: only one whose score is up again is seen.
        probable = self._score[which] > 0
        self.last_s[which] = np.where(probable, np.maximum(self.last_s[which], t_s), self.last_s[which])
        self._fit[which] += (evidence.mahalanobis2 - self._fit[which]) * (1 - MEMORY)

    def miss(self, camera: int, which: NDArray[np.intp], loss: float) -> None:
        """Camera should have seen targets `which` (K,) and did not."""
        self._hits[which, camera] *= MEMORY
        self._frames[which, camera] = self._frames[which, camera] * MEMORY + 1
        self._score[which] = np.maximum(self._score[which] + loss, -TOP_SCORE)

    def hold_back_unseen(self, now_s: float) -> None:
        """What nobody has lately seen has to be seen twice before it counts as back."""
        unseen = self.confirmed & (now_s - self.last_s > SEEN_LATELY_S)
        self._score = np.where(unseen, np.minimum(self._score, RETURN_SCORE), self._score)

    def confirm(self) -> list[int]:
        """Confirm the tentative targets that have earned it, and say which."""
        rate = self._hits / np.maximum(self._frames, 1e-9)
        counts = self._frames >= ENOUGH_FRAMES
        supporters = np.count_nonzero(counts & (rate >= SUPPORTS), axis=1)
        deniers = np.count_nonzero(counts & (rate < DENIES), axis=1)
        age_s = self.last_s - self._initiated_s
        plain = (supporters >= 2) & (deniers < np.maximum(supporters - 1, 1)) & (self._fit < BAD_FIT)
        lonely = (supporters >= 2) & (deniers < supporters) & (age_s > LONELY_S) & (self._fit < LONELY_FIT)
        earned = (self._score > CONFIRM_SCORE) & (age_s > CONFIRM_S) & (plain | lonely)
        new: list[int] = np.nonzero(earned & ~self.confirmed)[0].tolist()
        self.confirmed |= earned
        return new

    @property
    def denied(self) -> NDArray[np.bool_]:
        """Tentative targets (N,) that evidence speaks against."""
        return ~self.confirmed & (self._score < -10.0)

    def rivals(self, one: int, other: int) -> bool:
        """Whether two targets live off each other's detections: no camera holds both by different track numbers."""
        both = (self._seen_s[one] > self.last_s[one] - SEEN_LATELY_S) & (
            self._seen_s[other] > self.last_s[other] - SEEN_LATELY_S
        )
        rate = self._hits / np.maximum(self._frames, 1e-9)
        return not bool((both & (rate[one] > SUPPORTS) & (rate[other] > SUPPORTS)).any())

    def holds(self, camera: int, label: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(N, K) whether the camera's own track number of a detection is the one that it last had for a target."""
        same: NDArray[np.bool_] = (self.label[:, camera, None] == label[None]) & (label[None] > 0)
        return same

    def followed(self, t_s: float) -> NDArray[np.bool_]:
        """(N,) confirmed targets that some camera has just seen."""
        lately: NDArray[np.bool_] = self.confirmed & (t_s - self.last_s < SEEN_LATELY_S)
        return lately

    def astray(self, camera: int, which: NDArray[np.intp], t_s: float) -> NDArray[np.bool_]:
        """A camera has targets `which` (K,) outside their gates; (K,) whether that is the target's doing.

        One camera that says so while two others see the target where it should be has itself been knocked.
        """
        self._astray_s[which, camera] = t_s
        says_so = self._astray_s[which] > t_s - ASTRAY_S
        watching = says_so | (self._seen_s[which] > t_s - SEEN_LATELY_S)
        turned: NDArray[np.bool_] = (np.count_nonzero(says_so, axis=1) >= 2) | (np.count_nonzero(watching, axis=1) <= 2)
        return turned

    def seen_lately(self, camera: int) -> NDArray[np.bool_]:
        """Targets (N,) that this camera has lately seen, as of each one's last measurement."""
        seen: NDArray[np.bool_] = self._seen_s[:, camera] > self.last_s - SEEN_LATELY_S
        return seen

    def forget(self, camera: int) -> None:
        """What this camera saw and did not see counts no more."""
        self.label[:, camera] = NO_LABEL
        self._hits[:, camera] = self._frames[:, camera] = 0.0
        self._seen_s[:, camera] = -np.inf

    def watching(self, t_s: float) -> NDArray[np.intp]:
        """How many cameras have lately seen each target (N,)."""
        count: NDArray[np.intp] = np.count_nonzero(self.watched_by(t_s), axis=1)
        return count

    def watched_by(self, t_s: float) -> NDArray[np.bool_]:
        """(N, C) which cameras have lately seen each target."""
        lately: NDArray[np.bool_] = self._seen_s > t_s - SEEN_LATELY_S
        return lately

    def seen_by(self, target: int, t_s: float | None = None) -> list[int]:
        """Cameras that lately contributed to a target, as of t_s or else its last measurement."""
        recent = self._seen_s[target] > (self.last_s[target] if t_s is None else t_s) - SEEN_LATELY_S
        return [int(camera) for camera in np.nonzero(recent)[0]]

    def quality(self, target: int) -> float:
        """0..1: how sure it is that the target is a real object."""
        score = float(np.clip(self._score[target], -TOP_SCORE, TOP_SCORE))
        return 1.0 / (1.0 + float(np.exp(-score)))
