"""The study's results as a table a person reads and one a program reads."""

import csv
import io

import numpy as np

from tools.paper.trials import Outcome

WORST_FACTOR = 4.0  # times a level's mean: no trial may be worse
HEADER = (
    ("level", "published m", "classical m", "worst", "ours m", "worst", "to reach m", "failures", "CPU s", "verdict"),
    (":--", *("--:",) * 8, ":--"),
)


def markdown(outcomes: list[Outcome], seed: int) -> str:
    """One row a level: mean and worst RMSE of both chains beside the published and the wanted ones."""
    trials = len(outcomes[0].ours_m)
    rows = [*HEADER, *(_row(outcome) for outcome in outcomes)]
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return f"Seed {seed}, {trials} trials a level, mean RMSE over the 300 samples.\n\n" + "\n".join(lines) + "\n"


def _row(outcome: Outcome) -> tuple[str, ...]:
    level, mine, theirs = outcome.level, outcome.ours_m, outcome.classical_m
    figures = (level.published_m, np.mean(theirs), np.max(theirs), np.nanmean(mine), np.nanmax(mine), level.target_m)
    return (
        f"{level.study} {level.value:g}",
        *(f"{float(figure):.3g}" for figure in figures),
        str(outcome.failures),
        f"{outcome.ours_s.mean():.2f}",
        verdict(outcome),
    )


def verdict(outcome: Outcome) -> str:
    """ "reached", or what was missed."""
    mean, worst = float(np.nanmean(outcome.ours_m)), float(np.nanmax(outcome.ours_m))
    missed = []
    if outcome.failures:
        missed.append("failures")
    if not mean <= limit(outcome):
        missed.append("mean")
    if worst >= WORST_FACTOR * mean and not outcome.level.exact:
        missed.append("worst")
    return "missed: " + ", ".join(missed) if missed else "reached"


def limit(outcome: Outcome) -> float:
    """The mean RMSE to reach; for position errors, where "no worse" is asked, up to the trials' own uncertainty."""
    if outcome.level.study != "position error":
        return outcome.level.target_m
    chance = 3 * float(np.nanstd(outcome.ours_m) / np.sqrt(len(outcome.ours_m)))
    return outcome.level.target_m + chance


def comma_separated(outcomes: list[Outcome]) -> str:
    """Every trial: study, value, trial, classical_m, ours_m, ours_cpu_s."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("study", "value", "trial", "classical_m", "ours_m", "ours_cpu_s"))
    for outcome in outcomes:
        columns = zip(outcome.classical_m.tolist(), outcome.ours_m.tolist(), outcome.ours_s.tolist(), strict=True)
        for number, (theirs, mine, seconds) in enumerate(columns):
            level = outcome.level
            writer.writerow((level.study, level.value, number, f"{theirs:.9g}", f"{mine:.9g}", f"{seconds:.3f}"))
    return text.getvalue()
