"""Clocks set at random, found again: `python -m tools.bench.clocks FOLDER|simulated [...] [--draws N] [--seed S]`.

Each draw puts every camera's clock off by up to +-120 s and +-2500 ppm, seeded, solves, and compares with the truth:
clocks with those of the undisturbed solution and what was drawn, trajectory with truth.csv (or the simulation). The
site's own time and pace are nobody's to know where no clock is vouched for: a common offset and rate are taken out.
FOLDER is a track folder with truth.csv, by its name in ../shared/data or by its path.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.errors import CalibrationError
from calib.network import Network
from calib.observations import Scene
from calib.scoring.alignment import Alignment
from calib.scoring.timing import Path as Flown
from calib.scoring.trajectory import evaluate
from calib.simulation.description import CameraSpec, ObjectSpec, Roam, Simulation
from calib.simulation.simulation import simulate
from calib.solving.solution import Solution
from calib.solving.solve import solve
from calib.station.archive.replay_source import play_back
from calib.station.commands.score import read_truth
from edge.common.arrays import Array

RECORDINGS: Final = Path("../shared/data")
OFFSET_S: Final = 120.0  # of a clock that was set by hand
RATE: Final = 2.5e-3  # s/s: the worst of eth5's phones
WRONG_S: Final = 0.05  # of a clock that is told: 0.5 m at 10 m/s
WRONG_SHARE: Final = 2.0  # times the undisturbed error, plus WRONG_M: a trajectory that is wrong
WRONG_M: Final = 0.3
TRUTH_HZ: Final = 20.0
# The truth of eth3 is in a frame of its own, that of eth5 in the cameras'.
TRUTH_FRAMES: Final[dict[str, Alignment]] = {"eth3": "yaw", "posefree0619": "shift"}


@dataclass(frozen=True)
class Case:
    """A flight with its truth. t_ns: what the truth's seconds count from, if they are the cameras'."""

    name: str
    scene: Scene
    truth: Flown
    alignment: Alignment


@dataclass(frozen=True)
class Outcome:
    """One draw. clock_s: (C,) errors of the clocks at the ends of the flight, the worse of the two; rmse_m."""

    solved: int
    of: int
    clock_s: Array
    rmse_m: float
    wrong: bool


def cases(what: str, draws: int, seed: int) -> Iterator[tuple[Case, int]]:
    """The flights of a study, and the draw of each. Of simulated ones each draw is another flight."""
    for draw in range(draws):
        if what == "simulated":
            yield _simulated(seed, draw), draw
        elif draw == 0:
            folder = Path(what) if Path(what).is_dir() else RECORDINGS / what
            case = Case(folder.name, play_back(folder).scene, read_truth(folder / "truth.csv"), _alignment(folder))
            yield from ((case, number) for number in range(draws))


def _alignment(folder: Path) -> Alignment:
    return TRUTH_FRAMES.get(folder.name, "none")


def _simulated(seed: int, draw: int) -> Case:
    """Three to six cameras about a drone that wanders for one to five minutes."""
    rng = np.random.default_rng(np.random.SeedSequence((seed, draw, 1)))
    count, duration_s = int(rng.integers(3, 7)), float(rng.uniform(60.0, 300.0))
    angle = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count + rng.normal(0, 0.2, count)
    radius, height = rng.uniform(70, 120, count), rng.uniform(0, 4, count)
    cameras = tuple(
        CameraSpec(
            id=f"cam{k}", centre_enu=(radius[k] * np.cos(angle[k]), radius[k] * np.sin(angle[k]), height[k]),
            look_at_enu=(0.0, 0.0, 38.0), frame_rate_hz=float(rng.choice([10.0, 15.0, 25.0])), noise_px=0.5,
            drift_px=0.5, dropout=0.1, dropout_length_s=0.5, survey_error="gaussian",
        )
        for k in range(count)
    )  # fmt: skip
    drone = ObjectSpec(roam=Roam(home_enu=(0.0, 0.0, 40.0)))
    simulated = simulate(
        Simulation(seed=seed * 1000 + draw, object=(drone,), camera=cameras, duration_s=duration_s), draw
    )
    t_s = np.arange(0.0, duration_s, 1 / TRUTH_HZ)
    t_ns = simulated.start_unix_ns + np.round(t_s * 1e9).astype(np.int64)
    return Case("simulated", simulated.scene, Flown(t_s, simulated.truth_enu(t_ns)), "none")


def disturbed(scene: Scene, seed: int, draw: int) -> tuple[Scene, dict[str, tuple[float, float]]]:
    """The scene with stamps of other clocks, and what is to be added to them: offset (s) and rate about the middle."""
    rng = np.random.default_rng(np.random.SeedSequence((seed, draw, 2)))
    middle, rows, drawn = middle_ns(scene), {}, {}
    for name, own in sorted(scene.observations.items()):
        offset_s, rate = float(rng.uniform(-OFFSET_S, OFFSET_S)), float(rng.uniform(-RATE, RATE))
        since_s = (own.t_unix_ns - middle) * 1e-9
        stamps = middle + np.round((since_s - offset_s) / (1 + rate) * 1e9).astype(np.int64)
        rows[name], drawn[name] = replace(own, t_unix_ns=stamps), (offset_s, rate)
    return replace(scene, observations=rows), drawn


def middle_ns(scene: Scene) -> int:
    """The middle of the flight, by the stamps as they came."""
    ends = [int(own.t_unix_ns[k]) for own in scene.observations.values() for k in (0, -1)]
    return int(np.median(ends))


def held(case: Case, before: Solution, after: Solution, drawn: dict[str, tuple[float, float]]) -> Outcome:
    """A solution of disturbed stamps against that of the stamps as they came."""
    middle = middle_ns(case.scene)
    names = [camera.id for camera in after.network.cameras if before.network.camera(camera.id) is not None]
    off = []
    for name in names:
        own = case.scene.observations[name].t_unix_ns
        stamps = np.array([own[0], own[-1]])
        offset_s, rate = drawn[name]
        later = middle + np.round(((stamps - middle) * 1e-9 - offset_s) / (1 + rate) * 1e9).astype(np.int64)
        off.append(np.column_stack([_site_s(after.network, name, later), _site_s(before.network, name, stamps)]))
    clock_s = _without_common(np.array(off)) if off else np.zeros(0)
    error, usual = rmse_m(case, after), rmse_m(case, before)
    wrong = error > WRONG_SHARE * usual + WRONG_M or bool((clock_s > WRONG_S).any())
    return Outcome(len(after.network.cameras), len(before.network.cameras), clock_s, error, wrong)


def _site_s(network: Network, name: str, stamps: NDArray[np.int64]) -> Array:
    """(2,) site time of stamps, seconds from the network's own epoch, which the network's own pace is about."""
    camera = network.camera(name)
    assert camera is not None
    return camera.site_time_s(np.asarray(stamps, np.int64), np.zeros(len(stamps)), network.t_mid_unix_ns)


def _without_common(pairs: Array) -> Array:
    """(C,) worst error of each camera's two instants (C, 2, 2: found, known), a common offset and rate taken out."""
    found, known = pairs[:, :, 0].ravel(), pairs[:, :, 1].ravel()
    rate, offset = np.polyfit(known, found, 1)
    worst: Array = np.abs(found - (offset + rate * known)).reshape(-1, 2).max(axis=1)
    return worst


def rmse_m(case: Case, solution: Solution) -> float:
    """Of the trajectory against the truth, the truth's clock a shift and a rate off."""
    path, first = solution.trajectory, int(solution.trajectory.t_unix_ns[0])
    main = path.track == np.bincount(path.track).argmax()
    flown = Flown((path.t_unix_ns[main] - first) * 1e-9, path.points_enu[main])
    return float(evaluate(flown, case.truth, case.alignment, "rate").rmse_m)


def study(what: str, draws: int, seed: int) -> Iterator[str]:
    """A line a draw, then the figures."""
    outcomes: list[Outcome] = []
    refused, seconds, known = 0, [], {}
    for case, draw in cases(what, draws, seed):
        scene, drawn = disturbed(case.scene, seed, draw)
        if id(case) not in known:
            known = {id(case): solve(case.scene)}
        start = process_time()
        try:
            after = solve(scene)
        except CalibrationError as error:
            refused += 1
            yield f"{what} {draw}: refused: {error}"
            continue
        seconds.append(process_time() - start)
        own = held(case, known[id(case)], after, drawn)
        outcomes.append(own)
        yield (
            f"{what} {draw}: {own.solved} of {own.of} cameras, clocks {1e3 * np.median(own.clock_s):.1f} ms median, "
            f"{1e3 * own.clock_s.max():.1f} worst, trajectory {own.rmse_m:.3f} m, {seconds[-1]:.1f} CPU s"
            + (" WRONG" if own.wrong else "")
        )
    right = [own for own in outcomes if not own.wrong]
    whole = sum(own.solved == own.of for own in right)
    clocks = np.concatenate([own.clock_s for own in right]) if right else np.full(1, np.nan)
    of = len(outcomes) + refused
    rows = (
        ("wrong", "0", f"{len(outcomes) - len(right)} of {of}"),
        ("solved, not wrong", "95 %", f"{len(right)} of {of}, {whole} with as many cameras as undisturbed"),
        ("median clock error from the undisturbed", "3 ms", f"{1e3 * np.median(clocks):.1f} ms"),
        ("CPU, median", "-", f"{np.median(seconds) if seconds else np.nan:.1f} s"),
    )
    yield from (f"{what + ': ' + name:55s} asked {asked:5s} got {got}" for name, asked, got in rows)


def main(argv: list[str] | None = None) -> int:
    """Run the studies. Exit code 1 if any draw came out wrong."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench.clocks", description=__doc__)
    parser.add_argument("what", nargs="*", default=["simulated"], metavar="FOLDER|simulated")
    parser.add_argument("--draws", type=int, default=100, metavar="N", help="of each (100)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of all draws (0)")
    arguments = parser.parse_args(argv)
    print(f"seed {arguments.seed}, {arguments.draws} draws, offsets +-{OFFSET_S:g} s, rates +-{1e6 * RATE:.0f} ppm")
    wrong = False
    for what in arguments.what:
        for line in study(what, arguments.draws, arguments.seed):
            print(line, flush=True)
            wrong |= line.endswith("WRONG")
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
