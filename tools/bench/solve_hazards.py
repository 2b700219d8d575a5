"""Is the solver ever confidently wrong? Scenes of every kind of trouble that people bring, healthy ones among them.

    python -m tools.bench.solve_hazards [--scenes 300] [--seed 0] [--split choose] [--kinds A,B] [--processes 2]
                                        [--csv FILE] [--limit 60] [--keep FOLDER] [--list]
    python -m tools.bench.solve_hazards --cases ../shared/cases/solve

Every scene is written as a track folder, solved as `base-station solve` does, graded, and held against the truth
(tools/doubles/hazards/verdict.py says how). Exit code 1 if a trajectory is confidently wrong.
"""

import argparse
import csv
import logging
import multiprocessing
import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from time import process_time
from types import FrameType
from typing import Final

import numpy as np

from calib.errors import SkyfixError
from calib.solving.solution import Solution
from calib.solving.solve import SolveOptions, solve
from calib.station.archive.replay_source import play_back
from calib.station.report import summarise
from tools.doubles.hazards import accusations, folder
from tools.doubles.hazards.accusations import Accusation
from tools.doubles.hazards.brought import Brought
from tools.doubles.hazards.cases import brought_from
from tools.doubles.hazards.kinds import KINDS, Split, draw, planned
from tools.doubles.hazards.verdict import score
from tools.paper.trials import ONE_THREAD

LIMIT_S: Final = 60.0  # CPU seconds of one scene; a usual one takes two
MOST_RATIO: Final = 2.0  # squared error over squared sigma, that is asked of two cameras on a short base


class _OverLimit(Exception):  # noqa: N818
    """A scene's CPU seconds are used up."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """One scene's row. outcome: solved, refused, limit, or the name of an exception that should not have come out."""

    kind: str
    number: int
    cameras: int
    healthy: bool
    note: str
    guilty: str
    outcome: str
    reason: str = ""
    cpu_s: float = 0.0
    rows: int = 0
    rmse_m: float = np.nan
    sigma_m: float = np.nan
    nees: float = np.nan
    beyond: float = np.nan
    beyond_length: float = np.nan
    wrong: bool = False
    grade: str = ""
    used: int = 0
    innocents: str = ""
    named: str = ""
    said: str = ""


@dataclass(frozen=True)
class Job:
    """A scene to solve. keep: folder to leave it in, or None. case: a scene file instead of one that is drawn.

    number: of the scene of its kind, or of the file's trial.
    """

    kind: str
    number: int
    split: Split
    seed: int
    limit_s: float
    keep: Path | None
    case: Path | None = None


def judge(job: Job) -> Answer:
    """Draw, solve and judge one scene."""
    logging.disable(logging.WARNING)
    brought = brought_from(job.case, job.number) if job.case else draw(job.kind, job.split, job.seed, job.number)
    answered = partial(
        Answer,
        kind=job.kind,
        number=job.number,
        cameras=len(brought.cameras),
        healthy=brought.healthy,
        note=brought.note,
        guilty=" ".join(sorted(brought.guilty)),
    )
    start = process_time()
    try:
        with _at_most(job.limit_s):
            solution, grade = _solved(brought, job)
    except SkyfixError as refusal:
        named = accusations.in_refusal(str(refusal), brought.cameras)
        answer = answered(outcome="refused", reason=str(refusal), cpu_s=process_time() - start)
        return _blaming(answer, named, brought.guilty)
    except _OverLimit:
        return answered(outcome="limit", cpu_s=process_time() - start)
    except Exception as error:  # noqa: BLE001 - what should never come out is an outcome of its own, with its name
        return answered(outcome=type(error).__name__, reason=str(error), cpu_s=process_time() - start)
    cpu_s, got = process_time() - start, score(brought, solution)
    answer = answered(
        outcome="solved",
        cpu_s=cpu_s,
        wrong=got.confidently_wrong,
        grade=grade,
        used=len(solution.network.cameras),
        **asdict(got),
    )
    return _blaming(answer, accusations.in_report(solution.report, brought.cameras), brought.guilty)


def _solved(brought: Brought, job: Job) -> tuple[Solution, str]:
    """The answer of `base-station solve` to a scene, with its grade. Raises SkyfixError where it refuses."""
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch) if job.keep is None else job.keep / f"{job.kind}-{job.number}"
        folder.write(brought, place)
        played = play_back(place)
    solution = solve(played.scene, SolveOptions(evidence=True))
    return solution, summarise(solution).grade


def _blaming(answer: Answer, named: list[Accusation], guilty: frozenset[str]) -> Answer:
    """The row with who was named, who of them is innocent, and the sentences."""
    innocents = sorted({name for accusation in named for name in accusation.innocent(guilty)})
    everyone = sorted({name for accusation in named for name in accusation.cameras})
    said = " | ".join(accusation.sentence for accusation in named)
    return replace(answer, innocents=" ".join(innocents), named=" ".join(everyone), said=said)


@contextmanager
def _at_most(limit_s: float) -> Iterator[None]:
    """Raises _OverLimit inside once that many CPU seconds have gone."""

    def stop(_: int, __: FrameType | None) -> None:
        raise _OverLimit

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def answers(jobs: list[Job], processes: int) -> Iterator[Answer]:
    """All answers as they come; each depends on its own scene only."""
    if processes == 1:
        yield from map(judge, jobs)
        return
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # read by the children when they load numpy
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield from pool.imap_unordered(judge, jobs)


def table(got: list[Answer]) -> Iterator[str]:
    """One line a kind, and one over all."""
    heading = (
        "kind                  scenes solved refus. limit  CPU s  RMSE m sigma m NEES/3 beyond   wrong innoc. grades"
    )
    yield heading
    for kind in dict.fromkeys(answer.kind for answer in got):
        yield _line(kind, [answer for answer in got if answer.kind == kind])
    yield _line("ALL", got)


def _line(name: str, got: list[Answer]) -> str:
    solved = [answer for answer in got if answer.outcome == "solved"]
    refused = sum(answer.outcome == "refused" for answer in got)
    rest = len(got) - len(solved) - refused
    grades = "".join(sorted(answer.grade for answer in solved))
    grades = " ".join(f"{letter}{grades.count(letter)}" for letter in sorted(set(grades)))

    def middle(column: str) -> float:
        return float(np.median([getattr(answer, column) for answer in solved])) if solved else np.nan

    return (
        f"{name:22s}{len(got):5d} {len(solved):6d} {refused:6d} {rest:5d} {np.mean([a.cpu_s for a in got]):6.1f} "
        f"{middle('rmse_m'):7.2f} {middle('sigma_m'):7.2f} {middle('nees'):6.1f} {middle('beyond'):6.3f} "
        f"{sum(a.wrong for a in got):7d} {sum(bool(a.innocents) for a in got):6d} {grades}"
    )


def failures(got: list[Answer]) -> Iterator[str]:
    """Every scene that is not as it should be: confidently wrong, healthy and refused, somebody innocent named."""
    for answer in got:
        where = f"{answer.kind} {answer.number} ({answer.cameras} cameras{', ' * bool(answer.note)}{answer.note})"
        if answer.wrong:
            yield (
                f"WRONG    {where}: {answer.rmse_m:.2f} / {answer.sigma_m:.2f} m, {answer.beyond:.0%} beyond, "
                f"grade {answer.grade}"
            )
        if answer.healthy and answer.outcome == "refused":
            yield f"REFUSED  {where}: {answer.reason}"
        if answer.innocents:
            yield f"INNOCENT {where}: {answer.innocents} named, at fault: {answer.guilty or 'nobody'}: {answer.said}"
        if answer.outcome not in ("solved", "refused"):
            yield f"{answer.outcome.upper():8s} {where}: {answer.reason} {answer.cpu_s:.0f} s"


def figures(got: list[Answer]) -> Iterator[tuple[str, str, str]]:
    """Asked beside got."""
    healthy = [answer for answer in got if answer.healthy]
    wrong = sum(answer.wrong for answer in got)
    refused = sum(answer.outcome != "solved" for answer in healthy)
    yield "scenes confidently wrong (rows beyond 4 sigma > 1 %)", "0", f"{wrong} of {len(got)}"
    yield "healthy scenes refused", "< 2 %", f"{refused} of {len(healthy)}"
    yield "scenes in which somebody innocent is named", "0", f"{sum(bool(answer.innocents) for answer in got)}"
    solved = [answer for answer in got if answer.outcome == "solved"]
    sound = [answer for answer in solved if answer.healthy]
    yield "mean NEES/3 of healthy scenes, largest", "1", _nees(sound)
    yield "mean NEES/3 of all solved, largest", "-", _nees(solved)
    if two := [(answer.rmse_m / answer.sigma_m) ** 2 for answer in solved if answer.kind == "two_cameras"]:
        above, of = sum(ratio > MOST_RATIO for ratio in two), sum(answer.kind == "two_cameras" for answer in got)
        yield (
            "two cameras: squared error over squared sigma, largest",
            f"<= {MOST_RATIO:g}",
            f"{max(two):.2f}, {above} above, {len(two)} of {of} solved",
        )
    yield (
        "CPU seconds a scene: mean, largest",
        "-",
        (f"{np.mean([answer.cpu_s for answer in got]):.1f}, {max(answer.cpu_s for answer in got):.1f}"),
    )


def _nees(got: list[Answer]) -> str:
    values = [answer.nees for answer in got]
    return f"{np.mean(values):.2f}, {max(values):.1f}" if values else "-"


def _write(got: list[Answer], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Answer)])
        writer.writeheader()
        for answer in got:
            writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in asdict(answer).items()})


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.bench.solve_hazards", description=__doc__)
    parser.add_argument("--scenes", type=int, default=300, metavar="N", help="how many in all (300)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of all scenes (0)")
    parser.add_argument("--split", choices=("choose", "report"), default="choose", help="which scenes are drawn")
    parser.add_argument("--kinds", metavar="A,B", help="only these, by the beginnings of their names")
    parser.add_argument("--number", type=int, metavar="K", help="only scene K of each kind")
    parser.add_argument("--processes", type=int, default=2, metavar="N", help="at once (2)")
    parser.add_argument("--limit", type=float, default=LIMIT_S, metavar="S", help="CPU seconds of one scene (60)")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="one row a scene")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="leave the track folders there")
    parser.add_argument("--cases", type=Path, metavar="FOLDER", help="the scene files of a folder instead")
    parser.add_argument("--trials", type=int, default=1, metavar="N", help="of each of those files (1)")
    parser.add_argument("--list", action="store_true", help="the kinds, and nothing else")
    return parser.parse_args(argv)


def _jobs(asked: argparse.Namespace, kinds: list[str]) -> list[Job]:
    given = {"split": asked.split, "seed": asked.seed, "limit_s": asked.limit, "keep": asked.keep}
    if asked.cases:
        files, trials = sorted(asked.cases.glob("*.toml")), range(asked.trials)
        return [Job(kind=path.stem, number=trial, case=path, **given) for path in files for trial in trials]
    plan = planned(kinds, asked.scenes) if asked.number is None else [(kind, asked.number) for kind in kinds]
    return [Job(kind=kind, number=number, **given) for kind, number in plan]


def main(argv: list[str] | None = None) -> int:
    """Solve the scenes and print the tables."""
    asked = _arguments(argv)
    beginnings = tuple(asked.kinds.split(",")) if asked.kinds else ("",)
    kinds = [name for name in KINDS if name.startswith(beginnings)]
    if asked.list or not kinds:
        print("\n".join(KINDS))
        return 0 if kinds else 2
    jobs = _jobs(asked, kinds)
    got = []
    for answer in answers(jobs, asked.processes):
        got.append(answer)
        print(f"\r{len(got)} of {len(jobs)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    order = list(dict.fromkeys((*KINDS, *(job.kind for job in jobs))))
    got.sort(key=lambda answer: (order.index(answer.kind), answer.number))
    if asked.csv:
        _write(got, asked.csv)
    print(f"split {asked.split}, seed {asked.seed}, {len(jobs)} scenes")
    print(*table(got), sep="\n")
    print(*failures(got), sep="\n")
    for what, wanted, had in figures(got):
        print(f"{what:56s} {wanted:>8s}  {had}")
    return int(any(answer.wrong for answer in got))


if __name__ == "__main__":
    sys.exit(main())
