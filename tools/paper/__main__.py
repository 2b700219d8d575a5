"""Reproduce the published simulation study: `python -m tools.paper --trials 100 -o out/paper`.

Prints one table of both chains beside the published and the wanted figures, and writes it with every trial and the
figures (PNG and SVG). Exit code 0 only if every level reached what was asked.
"""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from edge.common.errors import SkyfixError
from tools.paper import figures, tables
from tools.paper.study import LEVELS, Level
from tools.paper.trials import Outcome, study, workers

BAR = 30  # characters


class Bar:
    """A progress bar on stderr: what is being done, how far, how long it will still take."""

    def __init__(self, total: int) -> None:
        self.total, self.done, self.doing, self.start = total, 0, "", time.monotonic()

    def __call__(self, count: int) -> None:
        self.done += count
        full = BAR * self.done // self.total
        left_s = (time.monotonic() - self.start) * (self.total - self.done) / max(self.done, 1)
        text = f"\r[{'#' * full}{'.' * (BAR - full)}] {self.done}/{self.total} {self.doing:20s} {left_s:6.0f} s left "
        print(text, end="\n" if self.done == self.total else "", file=sys.stderr, flush=True)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.paper", description=__doc__)
    parser.add_argument("--trials", type=int, default=20, metavar="N", help="trials a level (default 20)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of all errors (default 1)")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: all cores)"
    )
    parser.add_argument("--only", default="", metavar="TEXT", help='levels whose name holds this, e.g. "pixel error"')
    parser.add_argument("-o", "--output", type=Path, default=Path("out/paper"), metavar="FOLDER", help="where to write")
    arguments = parser.parse_args(argv)
    if arguments.trials < 1 or arguments.jobs < 1 or arguments.seed < 0:
        parser.error("--trials and --jobs must be at least 1, --seed at least 0")
    return arguments


def run(levels: Sequence[Level], trials: int, seed: int, jobs: int) -> list[Outcome]:
    """All trials of all levels."""
    bar = Bar(len(levels) * trials)
    outcomes = []
    with workers(jobs) as work:
        for level in levels:
            bar.doing = level.name
            outcomes.append(study(level, trials, seed, work, bar))
    return outcomes


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, print and write it."""
    arguments = _arguments(argv)
    levels = [level for level in LEVELS if arguments.only in level.name]
    if not levels:
        names = ", ".join(level.name for level in LEVELS)
        print(f"--only {arguments.only!r}: no such level; there are {names}", file=sys.stderr)
        return 2
    print(f"seed {arguments.seed}")
    outcomes = run(levels, arguments.trials, arguments.seed, arguments.jobs)
    text = tables.markdown(outcomes, arguments.seed)
    print(text)
    try:
        arguments.output.mkdir(parents=True, exist_ok=True)
        (arguments.output / "study.md").write_text(text, encoding="utf-8")
        (arguments.output / "trials.csv").write_text(tables.comma_separated(outcomes), encoding="utf-8")
        figures.draw(outcomes, arguments.output)
    except OSError as error:
        print(SkyfixError(f"cannot be written ({error})", where=str(arguments.output), action="choose another -o"))
        return 1
    print(f"written to {arguments.output}")
    return 0 if all(tables.verdict(outcome) == "reached" for outcome in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
