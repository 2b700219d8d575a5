"""The study as pictures, each a PNG and an SVG: the scene, the errors by level, and how they spread over the trials."""

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from calib.simulation.flight import flight
from tools.paper.study import INTERVAL_S, LEVELS, SAMPLES, simulation
from tools.paper.trials import Outcome

AXES: Final = {"pixel error": "px", "scene scale": "times 100 m, with 3 px and 0.2 m", "position error": "m"}
THEIRS, MINE, ASKED = "tab:red", "tab:blue", "black"


def draw(outcomes: list[Outcome], folder: Path) -> list[Path]:
    """Draw all figures into `folder`; returns the files written. The same outcomes give the same SVG."""
    mpl.use("Agg")
    with mpl.rc_context({"svg.hashsalt": "skyfix", "figure.dpi": 150, "font.size": 9}):
        pictures = {"scene": _scene(), "rmse": _rmse(outcomes), "spread": _spread(outcomes)}
        written = []
        for name, picture in pictures.items():
            for kind, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
                path = folder / f"{name}.{kind}"
                picture.savefig(path, metadata=metadata)
                written.append(path)
            plt.close(picture)
    return written


def _scene() -> Any:
    description = simulation(LEVELS[0], seed=0)
    path = flight(description.object[0])
    points = path.position_enu(np.arange(SAMPLES) * INTERVAL_S)
    figure = plt.figure(figsize=(5, 4.5), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
    axes.plot(*points.T, color=MINE, linewidth=1)
    axes.scatter(*np.array(description.object[0].waypoints_enu).T, color=MINE, s=8)
    for camera in description.camera:
        axes.scatter(*camera.centre_enu, color=THEIRS, marker="^", s=40)
        axes.text(*camera.centre_enu, camera.id)
    axes.set(xlabel="east m", ylabel="north m", zlabel="up m", title="the study's flight and cameras")
    return figure


def _by_study(outcomes: list[Outcome]) -> dict[str, list[Outcome]]:
    """Levels that can be drawn on a logarithmic scale, by study."""
    studies = dict.fromkeys(outcome.level.study for outcome in outcomes)
    return {study: [o for o in outcomes if o.level.study == study and not o.level.exact] for study in studies}


def _rmse(outcomes: list[Outcome]) -> Any:
    studies = {study: own for study, own in _by_study(outcomes).items() if own}
    figure, panels = plt.subplots(1, max(len(studies), 1), figsize=(10, 3.6), layout="constrained", squeeze=False)
    for axes, (study, own) in zip(panels[0], studies.items(), strict=False):
        value = np.array([outcome.level.value for outcome in own])
        for label, colour, columns in (
            ("classical chain", THEIRS, [outcome.classical_m for outcome in own]),
            ("this project", MINE, [outcome.ours_m for outcome in own]),
        ):
            axes.plot(value, [np.nanmean(column) for column in columns], "o-", color=colour, label=label)
            low, high = ([f(column) for column in columns] for f in (np.nanmin, np.nanmax))
            axes.fill_between(value, low, high, color=colour, alpha=0.15)
        axes.plot(value, [outcome.level.published_m for outcome in own], "x--", color="grey", label="published")
        axes.plot(value, [outcome.level.target_m for outcome in own], "_", color=ASKED, markersize=14, label="to reach")
        axes.set(yscale="log", xlabel=f"{study}, {AXES[study]}", ylabel="mean RMSE m (band: all trials)")
        axes.grid(alpha=0.3, which="both")
    panels[0][0].legend()
    return figure


def _spread(outcomes: list[Outcome]) -> Any:
    shown = [outcome for outcome in outcomes if not outcome.level.exact]
    figure, axes = plt.subplots(figsize=(10, 3.6), layout="constrained")
    for shift, colour, columns in (
        (-0.2, THEIRS, [outcome.classical_m for outcome in shown]),
        (0.2, MINE, [outcome.ours_m[np.isfinite(outcome.ours_m)] for outcome in shown]),
    ):
        for place, column in enumerate(columns):
            box = axes.boxplot([column], positions=[place + shift], widths=0.3, flierprops={"markersize": 2})
            plt.setp([*box["boxes"], *box["whiskers"], *box["caps"], *box["medians"]], color=colour)
    axes.set_xticks(range(len(shown)), [outcome.level.name for outcome in shown], rotation=40, ha="right")
    axes.set(yscale="log", ylabel="RMSE m", title="every trial: classical chain (red), this project (blue)")
    axes.grid(alpha=0.3, axis="y")
    return figure
