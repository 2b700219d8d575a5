"""What a tracker made of the scenes of a kind: the benches' and the tests' own count.

Ten times a second, from two seconds on: squared errors, NEES, who was missed, renumbered or false, and when objects
were found. A target is one object's if that is the nearest and near enough; whoever no camera saw for long
may come back as somebody new.
"""

from collections import defaultdict
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from calib.scoring.consistency import CHI2_3_999
from calib.tracking.estimates import TargetEstimate, TargetState
from calib.tracking.targets import Tracker
from tools.doubles.flight import T0_UNIX_NS, Scene
from tools.doubles.tracker_kinds import Kind, frames_of, hidden, scene_of

EVERY_S: Final = 0.1
SETTLED_S: Final = 2.0
NEAR_M: Final = 5.0  # or four sigma, whichever is more: a target is near its object
LOST_S: Final = 2.0  # s out of sight, after which nobody can know that it is the same
FALSE_S: Final = 1.0  # s that a target must be far from all objects to be a false one


@dataclass
class Score:
    """What was counted over the scenes of a kind."""

    squared_m2: list[float] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    seen: int = 0
    missed: int = 0
    renumbered: int = 0
    false: int = 0
    born_s: list[float] = field(default_factory=list)

    def row(self, name: str) -> str:
        """One line of the table."""
        nees = np.array(self.nees or [np.nan])
        return (
            f"{name:34} {np.sqrt(np.mean(self.squared_m2 or [np.nan])):7.3f} {nees.mean():6.2f}"
            f" {np.mean(nees > CHI2_3_999):7.2%} {self.missed / max(self.seen, 1):7.2%} {self.renumbered:5d}"
            f" {self.false:5d} {np.median(self.born_s):6.2f} {np.max(self.born_s):6.2f}"
        )


HEAD: Final = f"{'kind':34} {'RMSE m':>7} {'NEES':>6} {'beyond':>7} {'missed':>7} renum false born s: median, last"


def score(kind: Kind, seeds: range) -> Score:
    """Track a kind's scenes."""
    total = Score()
    for seed in seeds:
        scene = scene_of(kind, seed)
        _Watch(kind, scene, total).follow()
    return total


class _Watch:
    """One scene: which object each target is, and since when."""

    def __init__(self, kind: Kind, scene: Scene, total: Score) -> None:
        self._kind, self._scene, self._score = kind, scene, total
        self._numbers: defaultdict[int, list[int]] = defaultdict(list)
        self._first_seen_s: dict[int, float] = {}
        self._born_s: dict[int, float] = {}
        self._far_since_s: dict[int, float] = {}
        self._left_s: dict[int, float] = {}
        self._false: set[int] = set()

    def follow(self) -> None:
        """Track it, and count."""
        tracker, due_s = Tracker(self._scene.network), 0.0
        for frame in frames_of(self._kind, self._scene):
            tracker.observe(frame)
            tracker.advance(tracker.newest_s)
            if tracker.newest_s >= due_s:
                due_s = tracker.newest_s + EVERY_S
                self._look(tracker)
        self._score.renumbered += sum(max(len(own) - 1, 0) for own in self._numbers.values())
        self._score.false += len(self._false)
        never_s = self._scene.spec.duration_s
        self._score.born_s += [self._born_s.get(k, never_s) - t_s for k, t_s in self._first_seen_s.items()]

    def _look(self, tracker: Tracker) -> None:
        t_s = tracker.newest_s
        truth = self._scene.positions(T0_UNIX_NS + round(t_s * 1e9))
        said = tracker.predicted(t_s)
        apart_m = np.linalg.norm(truth[:, None] - np.array([e.position_enu for e in said]).reshape(1, -1, 3), axis=2)
        near = apart_m < np.array([max(NEAR_M, 4 * _sigma_m(e)) for e in said])[None]
        visible = self._visible(truth, t_s)
        self._forget_who_left(truth, t_s)
        for k in np.nonzero(visible)[0].tolist():
            self._first_seen_s.setdefault(k, t_s)
            own = [j for j in np.nonzero(near[k])[0].tolist() if apart_m[:, j].argmin() == k]
            if own:
                self._found(k, said[own[int(apart_m[k, own].argmin())]], truth[k], t_s)
            if t_s > SETTLED_S:
                self._score.seen += 1
                self._score.missed += not own
        for j, e in enumerate(said):
            if near[:, j].any():
                self._far_since_s.pop(e.track, None)
            elif t_s - self._far_since_s.setdefault(e.track, t_s) > FALSE_S:
                self._false.add(e.track)

    def _found(self, k: int, e: TargetEstimate, truth: np.ndarray, t_s: float) -> None:
        self._born_s.setdefault(k, t_s)
        if e.track not in self._numbers[k]:
            self._numbers[k].append(e.track)
        if t_s > SETTLED_S and e.state is TargetState.CONFIRMED:
            error = truth - e.position_enu
            self._score.squared_m2.append(float(error @ error))
            self._score.nees.append(float(error @ np.linalg.solve(e.covariance[:3, :3], error)))

    def _forget_who_left(self, truth: np.ndarray, t_s: float) -> None:
        """Whoever no camera could have seen for so long that it is lost comes back as somebody new."""
        for k, seen in enumerate(self._in_view(truth, t_s)[self._looking(t_s)].sum(axis=0).tolist()):
            if seen:
                self._left_s.pop(k, None)
            elif t_s - self._left_s.setdefault(k, t_s) > LOST_S:
                self._numbers[k].clear()

    def _visible(self, truth: np.ndarray, t_s: float) -> np.ndarray:
        """(objects,) whether two cameras have each in view and are not blind."""
        enough: np.ndarray = self._in_view(truth, t_s)[self._looking(t_s)].sum(axis=0) >= 2
        return enough

    def _looking(self, t_s: float) -> list[bool]:
        return [not hidden(self._kind, number, t_s) for number in range(self._kind.cameras)]

    def _in_view(self, truth: np.ndarray, t_s: float) -> np.ndarray:
        """(cameras, objects) whether each would see each."""
        cameras, at_s = self._scene.watched.cameras, np.full(len(truth), t_s)
        return np.array([np.isfinite(camera.project(truth, at_s)[1]) for camera in cameras])


def _sigma_m(e: TargetEstimate) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(e.covariance[:3, :3])[-1]))
