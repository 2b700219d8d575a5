"""Many trials of one level, on all cores.

Every trial is drawn from the seed and its own number, so the result does not depend on how many processes share them.
"""

import multiprocessing
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import process_time

import numpy as np

from calib.errors import SkyfixError
from edge.common.arrays import Array
from tools.paper.chains import EXACT, USUAL, classical, ours
from tools.paper.study import Level, draw, truth_enu

Progress = Callable[[int], None]
Trial = tuple[Level, int, int]  # level, seed, number
# Threads of the linear algebra below would fight with the processes above for the same cores.
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Outcome:
    """All trials of a level. classical_m, ours_m: (N,) RMSE, NaN where a chain failed; ours_s: (N,) CPU seconds."""

    level: Level
    classical_m: Array
    ours_m: Array
    ours_s: Array

    @property
    def failures(self) -> int:
        """Trials in which the adjustment gave no answer."""
        return int(np.isnan(self.ours_m).sum())


@contextmanager
def workers(count: int) -> Iterator[Callable[[list[Trial]], Iterator[tuple[float, float, float]]]]:
    """`count` processes as a function from trials to their results, in order; one process is this one."""
    if count == 1:
        yield lambda trials: map(run, trials)
        return
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # read by the children when they load numpy
    with multiprocessing.get_context("spawn").Pool(count) as pool:
        yield lambda trials: pool.imap(run, trials, chunksize=max(1, min(20, len(trials) // (4 * count))))
    for name, value in before.items():
        os.environ.pop(name) if value is None else os.environ.update({name: value})


def run(trial: Trial) -> tuple[float, float, float]:
    """RMSE in metres of the classical chain and of ours, and the CPU seconds of ours."""
    level, seed, number = trial
    simulated = draw(level, seed, number)
    truth = truth_enu(simulated)
    published = _rmse(classical(simulated.scene), truth)
    start = process_time()
    try:
        mine = _rmse(ours(simulated.scene, EXACT if level.exact else USUAL), truth)
    except SkyfixError:
        mine = float("nan")
    return published, mine, process_time() - start


def _rmse(points: Array, truth: Array) -> float:
    return float(np.sqrt(((points - truth) ** 2).sum(1).mean()))


def study(
    level: Level,
    trials: int,
    seed: int,
    work: Callable[[list[Trial]], Iterator[tuple[float, float, float]]],
    progress: Progress,
) -> Outcome:
    """All trials of a level; progress is told of each that is done."""
    results = []
    for result in work([(level, seed, number) for number in range(trials)]):
        results.append(result)
        progress(1)
    table = np.array(results)
    return Outcome(level, table[:, 0], table[:, 1], table[:, 2])
