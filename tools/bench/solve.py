"""The calibration's figures on real recordings and in simulation: `python -m tools.bench.solve [STUDY ...]`.

Studies: recordings, windows, clocks, length, consistency (all by default). The recordings go through the real
`base-station solve`, in a process whose CPU seconds and peak memory are its own; the rest calls calib.solving.solve.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Final

import numpy as np
from scipy import stats

from calib.errors import CalibrationError
from calib.network import from_toml
from calib.observations import Observations, Scene
from calib.scoring.trajectory import evaluate
from calib.simulation.description import CameraSpec, LensFault, ObjectSpec, Simulation
from calib.simulation.simulation import simulate
from calib.solving.solution import Solution
from calib.solving.solve import solve
from calib.station.archive.replay_source import play_back
from calib.station.commands.score import read_trajectory, read_truth
from calib.station.commands.solve import restricted
from edge.common.arrays import Array
from tools.paper.trials import ONE_THREAD

RECORDINGS: Final = Path("../shared/data")
# Recording, alignment, what of it, RMSE or median to reach (m).
ASKED: Final = (
    ("eth3", "yaw", "rmse_m", 0.20),
    ("eth3", "sim3", "rmse_m", 0.18),
    ("posefree0619", "shift", "rmse_m", 1.8),
    ("posefree0619", "shift", "median_m", 0.9),
)
CENTRES_M: Final = {"eth3": 0.12, "posefree0619": 0.3}
WINDOW_S: Final = 60.0
FEWEST_CAMERAS: Final = 4
OFFSETS_S: Final = (0.0, 2.0, -2.0, 1.3, -0.7, 2.0, -1.6)  # added to the cameras in turn; the first is the reference
RATE: Final = 2e-4
INTERVAL: Final = 0.99  # of chi-square
Row = tuple[str, str, str]  # what, asked, got


def recordings(_: int) -> Iterator[Row]:
    """RMSE, camera centres, CPU seconds and peak memory of `base-station solve`."""
    for name in CENTRES_M:
        with tempfile.TemporaryDirectory() as folder:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            command = [sys.executable, "-m", "calib.station.app", "solve", str(RECORDINGS / name), "-o", folder]
            environment = os.environ | dict.fromkeys(ONE_THREAD, "1")
            done = subprocess.run(command, env=environment, check=False, capture_output=True, text=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            if done.returncode:
                yield f"{name}: solve", "0", f"exit code {done.returncode}: {done.stderr.strip()[-200:]}"
                continue
            seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            yield from _scored(name, Path(folder))
            yield f"{name}: CPU", "10 s" if name == "eth3" else "-", f"{seconds:.1f} s"
            # Peak of all children so far: the first recording is the larger one.
            yield f"{name}: peak memory", "0.4 GB" if name == "eth3" else "-", f"{after.ru_maxrss / 1e6:.2f} GB"


def _scored(name: str, folder: Path) -> Iterator[Row]:
    path, stated, _ = read_trajectory(folder / "trajectory.csv")
    truth = read_truth(RECORDINGS / name / "truth.csv")
    for recording, alignment, what, asked in ASKED:
        if recording == name:
            result = evaluate(path, truth, alignment, "rate", stated=stated)  # type: ignore[arg-type]
            yield f"{name}: {alignment}-aligned {what}", f"{asked:g} m", f"{getattr(result, what):.3f} m"
            for part in result.consistency:
                if "cameras" in part.over or part.over == "all":
                    yield f"  error over sigma, {part.over}", "0.9 to 1.15", f"{part.error_over_sigma:.2f}"
    network = from_toml((folder / "network.toml").read_text(encoding="utf-8"))
    sites = {camera.id: camera.position_enu for camera in play_back(RECORDINGS / name).scene.cameras}
    surveyed = [(camera.centre_enu, sites[camera.id]) for camera in network.cameras]
    off = [np.sum((centre - known) ** 2) for centre, known in surveyed if known is not None]
    yield f"{name}: centres against survey, rms", f"{CENTRES_M[name]:g} m", f"{np.sqrt(np.mean(off)):.3f} m"


def windows(_: int) -> Iterator[Row]:
    """Any 60 s of eth3 that four cameras see: trajectory against the whole flight's, and CPU seconds."""
    scene = play_back(RECORDINGS / "eth3").scene
    whole = _by_time(solve(scene))
    first = min(int(seen.t_unix_ns[0]) for seen in scene.observations.values())
    last = max(int(seen.t_unix_ns[-1]) for seen in scene.observations.values())
    medians, seconds, refused = [], [], 0
    for start_s in np.arange(0.0, (last - first) * 1e-9 - WINDOW_S, WINDOW_S / 2):
        part = restricted(scene, None, float(start_s), float(start_s) + WINDOW_S)
        if sum(len(seen) >= 30 * WINDOW_S / 10 for seen in part.observations.values()) < FEWEST_CAMERAS:
            continue
        start = process_time()
        try:
            own = _by_time(solve(part))
        except CalibrationError:
            refused += 1
            continue
        seconds.append(process_time() - start)
        common = sorted(own.keys() & whole.keys())
        medians.append(float(np.median([np.linalg.norm(own[t] - whole[t]) for t in common])))
    table = np.array(medians)
    yield "eth3, 60 s windows: solved", "all", f"{len(table)} of {len(table) + refused}"
    yield "  median difference: median, worst window", "0.25 m", f"{np.median(table):.3f} m, {table.max():.2f} m"
    yield "  windows within 0.25 m", "all", f"{int((table <= 0.25).sum())} of {len(table)}"
    yield "  CPU: median, worst", "1 s", f"{np.median(seconds):.2f} s, {max(seconds):.2f} s"


def _by_time(solution: Solution) -> dict[int, Array]:
    trajectory = solution.trajectory
    return dict(zip(trajectory.t_unix_ns.tolist(), trajectory.points_enu, strict=True))


def clocks(_: int) -> Iterator[Row]:
    """Offsets and rates added to eth3's cameras: recovered relative to the unaltered solution."""
    scene = play_back(RECORDINGS / "eth3").scene
    names = [camera.id for camera in scene.cameras]
    added = {name: OFFSETS_S[k % len(OFFSETS_S)] for k, name in enumerate(names)}
    rates = {name: RATE * (-1) ** k * (k > 0) for k, name in enumerate(names)}
    before, after = solve(scene), solve(_with_clocks(scene, added, rates))
    plain = {camera.id: camera for camera in before.network.cameras}
    seconds = (after.network.t_mid_unix_ns - before.network.t_mid_unix_ns) * 1e-9
    off = {}
    for camera in after.network.cameras:
        if camera.id in plain:
            was = plain[camera.id].clock_offset_s + plain[camera.id].clock_rate * seconds
            off[camera.id] = camera.clock_offset_s - was + added[camera.id]
    common = float(np.median(list(off.values())))  # the site's time itself is nobody's to know
    worst = max(abs(value - common) for value in off.values())
    yield "eth3, clocks +-2 s and 200 ppm: cameras", str(len(plain)), str(len(off))
    yield "  worst offset from the unaltered solution's", "2 ms", f"{1e3 * worst:.2f} ms"


def _with_clocks(scene: Scene, added: dict[str, float], rates: dict[str, float]) -> Scene:
    starts = [int(seen.t_unix_ns[0]) for seen in scene.observations.values()]
    ends = [int(seen.t_unix_ns[-1]) for seen in scene.observations.values()]
    middle = (int(np.median(starts)) + int(np.median(ends))) // 2

    def late(name: str, seen: Observations) -> Observations:
        since_s = (seen.t_unix_ns - middle) * 1e-9
        shift_ns = np.round((added[name] + rates[name] * since_s) * 1e9).astype(np.int64)
        return replace(seen, t_unix_ns=seen.t_unix_ns + shift_ns)

    return replace(scene, observations={name: late(name, seen) for name, seen in scene.observations.items()})


def length(_: int) -> Iterator[Row]:
    """CPU seconds of simulated flights, each twice as long as the one before."""
    for duration_s in (75.0, 150.0, 300.0, 600.0):
        scene = simulate(_flight(1, duration_s)).scene
        start = process_time()
        solve(scene)
        seconds = process_time() - start
        yield (
            f"flight of {duration_s:g} s: CPU",
            "linear",
            f"{seconds:.2f} s, {1e3 * seconds / duration_s:.1f} ms a second",
        )


def consistency(trials: int) -> Iterator[Row]:
    """Mean normalised squared error at the middle of simulated flights against its chi-square interval."""
    squared, refused = [], 0
    for trial in range(trials):
        simulated = simulate(_flight(trial, 60.0), trial)
        try:
            trajectory = solve(simulated.scene).trajectory
        except CalibrationError:
            refused += 1
            continue
        row = len(trajectory.t_unix_ns) // 2
        off = trajectory.points_enu[row] - simulated.truth_enu(trajectory.t_unix_ns[row : row + 1])[0]
        squared.append(float(off @ np.linalg.solve(trajectory.covariance_enu[row], off)))
    low, high = (stats.chi2.ppf((1 + side * INTERVAL) / 2, 3 * len(squared)) / len(squared) for side in (-1, 1))
    yield f"mean NEES of {len(squared)} flights", f"{low:.3f} to {high:.3f}", f"{np.mean(squared):.3f}"
    yield "  median (2.37), largest; refused", "-", f"{np.median(squared):.2f}, {max(squared):.1f}; {refused}"


def _flight(seed: int, duration_s: float) -> Simulation:
    """Four cameras about a drone, with the errors that priors and survey expect, and noise that is correlated."""
    rng = np.random.default_rng(seed)
    places = rng.uniform([-30, -30, 20], [30, 30, 60], (int(duration_s // 5) + 2, 3))
    centres = ((-70.0, -60.0, 1.0), (75.0, -55.0, 2.0), (5.0, 85.0, 0.0), (-80.0, 60.0, 3.0))
    cameras = tuple(
        CameraSpec(
            id=f"cam{k + 1}", centre_enu=centre, look_at_enu=(0.0, 0.0, 38.0), frame_rate_hz=15.0, phase_s=0.013 * k,
            noise_px=0.4, drift_px=0.3, drift_s=0.3, dropout=0.1, outlier=0.02, survey_error="gaussian",
            lens_error=LensFault(focal=0.01, centre_px=10.0, k1=0.01), clock_bound_s=1e-4,
        )
        for k, centre in enumerate(centres)
    )  # fmt: skip
    waypoints = tuple((float(x), float(y), float(z)) for x, y, z in places)
    drone = ObjectSpec(waypoints_enu=waypoints, step_s=5.0)
    return Simulation(seed=seed, object=(drone,), camera=cameras, duration_s=duration_s)


STUDIES: Final[dict[str, Callable[[int], Iterator[Row]]]] = {
    study.__name__: study for study in (recordings, windows, clocks, length, consistency)
}
REAL: Final = {"recordings", "windows", "clocks"}


def main(argv: list[str] | None = None) -> int:
    """Run the studies and print one table."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench.solve", description=__doc__)
    parser.add_argument("study", nargs="*", help=f"of {', '.join(STUDIES)} (default: all)")
    parser.add_argument("--trials", type=int, default=100, metavar="N", help="flights of the consistency study")
    arguments = parser.parse_args(argv)
    chosen = arguments.study or list(STUDIES)
    if unknown := [name for name in chosen if name not in STUDIES]:
        parser.error(f"no study {unknown[0]!r}, there are {', '.join(STUDIES)}")
    print(f"{'figure':48s} {'asked':>18s}  got")
    for name in chosen:
        if name in REAL and not RECORDINGS.is_dir():
            print(f"{name}: skipped, {RECORDINGS} is not there")
            continue
        for what, asked, got in STUDIES[name](arguments.trials):
            print(f"{what:48s} {asked:>18s}  {got}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
