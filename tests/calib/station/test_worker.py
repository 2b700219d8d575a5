"""The solving process: answers, faults as words, deaths, and an end that comes in time."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

import numpy as np

from calib.network import Network
from calib.observations import Scene
from calib.station.core.jobs import Solved, SolveJob
from calib.station.worker import Worker
from tests.conftest import Until
from tools.doubles.flight import ORIGIN, Spec, make

HERE: Final = "tests.calib.station.test_worker"
SPEC: Final = Spec(cameras=3, uavs=1, duration_s=1.0)
LARGE: Final = 1_000_000  # numbers in a job: far more than a pipe holds


class Reporter:
    """Solves at once, and reports."""

    def __call__(self, scene: Scene, start: Network | None) -> Solved:
        return Solved(make(SPEC).network, 0.1)

    def report(self, folder: Path) -> None:
        folder.mkdir()
        (folder / "report.json").write_text("{}")


at_once = Reporter()


def divides_by_nothing(scene: Scene, start: Network | None) -> Solved:
    return Solved(make(SPEC).network, 1 / len(scene.cameras))


def dies(scene: Scene, start: Network | None) -> Solved:
    os._exit(3)


def is_killed(scene: Scene, start: Network | None) -> Solved:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def never_ends(scene: Scene, start: Network | None) -> Solved:
    time.sleep(600)
    raise AssertionError


def job(number: int = 1, size: int = 10) -> SolveJob:
    return SolveJob(number, Scene("hill", ORIGIN, (), {"cam0": np.zeros(size)}), None)  # type: ignore[dict-item]


def solved(worker: Worker, until: Until, wanted: SolveJob):  # type: ignore[no-untyped-def]
    assert worker.submit(wanted)
    found = []
    assert until(lambda: (done := worker.poll()) is not None and (found.append(done) or True), within_s=60)
    return found[0]


def test_a_large_job_is_handed_over_solved_and_reported(until: Until, tmp_path: Path) -> None:
    with Worker(f"{HERE}:at_once") as worker:
        assert worker.submit(job(7, LARGE))
        assert worker.busy
        assert not worker.submit(job(8))
        found = []
        assert until(lambda: (done := worker.poll()) is not None and (found.append(done) or True), within_s=60)
        assert (found[0].number, found[0].error) == (7, None)
        assert not worker.busy
        worker.report(tmp_path / "report")
        assert until((tmp_path / "report" / "report.json").is_file, within_s=20)


def test_what_goes_wrong_in_it_comes_back_as_words(until: Until) -> None:
    with Worker(f"{HERE}:divides_by_nothing") as worker:
        done = solved(worker, until, job())
        assert done.solved is None
        assert "ZeroDivisionError" in done.error.what


def test_a_process_that_dies_fails_its_job_and_the_next_job_starts_another(until: Until) -> None:
    with Worker(f"{HERE}:dies") as worker:
        for number in (1, 2):
            done = solved(worker, until, job(number))
            assert (done.number, done.error.what) == (number, "the solver's process ended with code 3")


def test_only_a_process_that_was_killed_is_blamed_on_the_memory(until: Until) -> None:
    with Worker(f"{HERE}:is_killed") as worker:
        done = solved(worker, until, job())
        assert (done.error.what, "memory" in done.error.action) == ("the solver's process was killed", True)
    with Worker(f"{HERE}:dies") as worker:
        assert "memory" not in solved(worker, until, job()).error.action


def test_it_solves_where_the_service_may_not_change_its_priority() -> None:
    """As under a unit with SystemCallFilter=~@resources, where no installed base was ever calibrated."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.forbidden", "setpriority", HERE], capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["solved"], done.stderr
    assert "setpriority" in done.stderr


def test_it_ends_in_time_even_while_a_large_job_is_being_handed_over() -> None:
    with Worker(f"{HERE}:never_ends") as worker:
        assert worker.submit(job(1, LARGE))
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 5.0  # two seconds for the process, one for the thread, and a busy machine


def _solve_once() -> None:
    """What the test of a forbidden priority runs in a process of its own."""
    with Worker(f"{HERE}:at_once") as worker:
        assert worker.submit(job())
        deadline_s = time.monotonic() + 60.0
        while (done := worker.poll()) is None and time.monotonic() < deadline_s:
            time.sleep(0.01)
    print("no answer" if done is None else done.error or "solved")  # noqa: T201 -- the test reads it


if __name__ == "__main__":
    _solve_once()
