"""Many UAVs and birds at once: GOSPA, identity switches, false tracks, and whether the covariance is true.

`python -m tools.bench.station_tracking --scenes 20`. GOSPA after Rahmathullah, Garcia-Fernandez and Svensson (2017),
c = 10 m, p = 2, alpha = 2. Ten times a second, after each scene's first two seconds; objects that fewer than two
cameras see do not count as missed. Consistency: the normalised squared error of position, 3 when it is true, judged
over independent instants two seconds apart.
"""

import argparse
import time
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

from calib.tracking.estimates import TargetEstimate, TargetState
from calib.tracking.targets import Tracker
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, frames, make

CUT_M = 10.0
SETTLED_S = 2.0
EVERY_S = 0.1
APART_S = 2.0  # instants so far apart that their errors are independent of each other, but for the calibration
FALSE_M = 10.0  # a confirmed target farther from every object, for longer than COASTING_S, is false
FALSE_S = 1.0


@dataclass
class Tally:
    """What was counted over scenes."""

    gospa: list[float] = field(default_factory=list)
    localisation: list[float] = field(default_factory=list)
    missed: list[int] = field(default_factory=list)
    false: list[int] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    switches: int = 0
    false_tracks: int = 0
    target_s: float = 0.0
    scene_s: float = 0.0
    frame_ms: list[float] = field(default_factory=list)


def gospa(truth: np.ndarray, estimate: np.ndarray) -> tuple[float, float, int, int]:
    """GOSPA and its parts: squared localisation error, missed, false."""
    if len(truth) and len(estimate):
        distance = np.linalg.norm(truth[:, None] - estimate[None], axis=2)
        rows, columns = linear_sum_assignment(np.minimum(distance, CUT_M) ** 2)
        near = distance[rows, columns] < CUT_M
        located, pairs = float(np.sum(distance[rows, columns][near] ** 2)), int(near.sum())
    else:
        located, pairs = 0.0, 0
    missed, false = len(truth) - pairs, len(estimate) - pairs
    return float(np.sqrt(located + CUT_M**2 / 2 * (missed + false))), located, missed, false


def run(scene: Scene, tally: Tally) -> None:
    """Track a scene and score it."""
    tracker, watch = Tracker(scene.network), Watch(scene)
    due_s, last_nees_s = SETTLED_S, 0.0
    for _, frame in frames(scene):
        began = time.perf_counter()
        tracker.observe(frame)
        tracker.advance(tracker.newest_s)
        tally.frame_ms.append((time.perf_counter() - began) * 1e3)
        t_s = (frame.t_unix_ns - T0_UNIX_NS) * 1e-9
        if t_s < due_s:
            continue
        due_s += EVERY_S
        estimates = tracker.estimates(tracker.newest_s)
        at_now = np.array([_at(e, frame.t_unix_ns) for e in estimates]).reshape(-1, 3)
        truth = scene.positions(frame.t_unix_ns)
        value, _, missed, _ = gospa(truth[_visible(scene, frame.t_unix_ns)], at_now)
        _, located_all, _, wrong = gospa(truth, at_now)
        tally.gospa.append(value)
        tally.missed.append(missed)
        tally.false.append(wrong)
        if at_now.size:
            tally.localisation.append(located_all / max(len(at_now) - wrong, 1))
        tally.target_s += EVERY_S * len(estimates)
        watch.look(estimates, t_s)
        if t_s - last_nees_s >= APART_S:
            last_nees_s = t_s
            tally.nees += [_nees(e, scene) for e in estimates if e.state is TargetState.CONFIRMED]
    tally.false_tracks += len(watch.false)
    tally.switches += watch.switches
    tally.scene_s += scene.spec.duration_s


def _at(estimate: TargetEstimate, t_unix_ns: int) -> np.ndarray:
    return estimate.position_enu + estimate.velocity_enu * (t_unix_ns - estimate.t_unix_ns) * 1e-9


def _visible(scene: Scene, t_unix_ns: int) -> np.ndarray:
    truth, t_s = scene.positions(t_unix_ns), (t_unix_ns - T0_UNIX_NS) * 1e-9
    depths = [camera.project(truth, np.full(len(truth), t_s))[1] for camera in scene.watched.cameras]
    enough: np.ndarray = np.isfinite(depths).sum(axis=0) >= 2
    return enough


class Watch:
    """Which object each track has been, and which tracks have been none."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._owner: dict[int, int] = {}
        self._far_since: dict[int, float] = {}
        self.false: set[int] = set()
        self.switches = 0

    def look(self, estimates: list[TargetEstimate], t_s: float) -> None:
        """Take all tracks at an instant."""
        for estimate in estimates:
            apart = np.linalg.norm(self._scene.positions(estimate.t_unix_ns) - estimate.position_enu, axis=1)
            nearest = int(apart.argmin())
            if apart[nearest] < CUT_M / 2:
                self.switches += self._owner.get(estimate.track, nearest) != nearest
                self._owner[estimate.track] = nearest
            if apart[nearest] < FALSE_M or estimate.state is TargetState.COASTING:
                self._far_since.pop(estimate.track, None)
            elif t_s - self._far_since.setdefault(estimate.track, t_s) > FALSE_S:
                self.false.add(estimate.track)


def _nees(estimate: TargetEstimate, scene: Scene) -> float:
    error = scene.positions(estimate.t_unix_ns) - estimate.position_enu
    error = error[np.linalg.norm(error, axis=1).argmin()]
    return float(error @ np.linalg.solve(estimate.covariance[:3, :3], error))


def report(tally: Tally) -> None:
    """The table."""
    nees, n = np.minimum(tally.nees, 100.0), len(tally.nees)
    low, high = (float(chi2.ppf(part, 3 * n)) / n for part in (0.025, 0.975))
    rms = np.sqrt(np.mean(tally.localisation))
    print(
        f"GOSPA mean {np.mean(tally.gospa):.2f} m, median {np.median(tally.gospa):.2f} m; RMSE of matched {rms:.3f} m"
    )
    print(f"missed {np.mean(tally.missed):.3f} and false {np.mean(tally.false):.3f} targets, mean over instants")
    minutes = tally.target_s / 60
    print(f"identity switches {tally.switches} in {minutes:.0f} target-minutes")
    print(f"false confirmed tracks {tally.false_tracks} in {tally.scene_s / 3600:.2f} h")
    share = np.mean(nees < chi2.ppf(0.95, 3))
    print(f"NEES {np.mean(nees):.2f} (median {np.median(nees):.2f}, true would be 2.37) of {n}, 95 % interval "
          f"{low:.2f} to {high:.2f}; within 95 % ellipsoid: {share:.3f}")  # fmt: skip
    print(f"ms a frame: median {np.median(tally.frame_ms):.2f}, 99 % {np.percentile(tally.frame_ms, 99):.2f}")


def main() -> None:
    """Run the scenes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--cameras", type=int, default=6)
    parser.add_argument("--uavs", type=int, default=8)
    parser.add_argument("--birds", type=int, default=12)
    parser.add_argument("--rate", type=float, default=30.0)
    options = parser.parse_args()
    spec = Spec(
        cameras=options.cameras,
        uavs=options.uavs,
        birds=options.birds,
        rate_hz=options.rate,
        dropout=0.2,
        clutter=1.0,
        duration_s=options.seconds,
    )
    tally = Tally()
    for seed in range(options.scenes):
        run(make(replace(spec, seed=seed)), tally)
        print(f"seed {seed}: {tally.switches} switches, {tally.false_tracks} false so far", flush=True)
    report(tally)


if __name__ == "__main__":
    main()
