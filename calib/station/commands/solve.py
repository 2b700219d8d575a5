"""`base-station solve`: a track folder or a recording in; network, trajectory and report out."""

import argparse
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib import network
from calib.observations import Observations, Scene
from calib.solving.solution import Solution
from calib.solving.solve import SolveOptions, solve
from calib.station.archive.replay_source import play_back
from calib.station.archive.trajectory_file import write_trajectory
from calib.station.commands.arguments import add_config, folder_of
from calib.station.config import load
from calib.station.core.playback import Played
from calib.station.core.surveyed_site import SurveyedSite
from calib.station.report import Summary, write_report
from calib.station.survey.in_force import with_survey
from edge.common.atomic import write_atomically
from edge.common.errors import ConfigError
from edge.common.units import NS

log = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the subcommand."""
    parser.add_argument("input", type=Path, metavar="FOLDER_OR_RECORDING", help="a track folder or a .mcap recording")
    what = "the survey to solve a recording with, instead of the one in force when it was made; no default"
    add_config(parser, needed=False, what=what)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="folder for the results")
    parser.add_argument("--cameras", metavar="A,B,...", help="use only these cameras")
    parser.add_argument("--from", dest="from_s", type=float, metavar="S", help="seconds after the first row")
    parser.add_argument("--to", dest="to_s", type=float, metavar="S", help="seconds after the first row")
    parser.add_argument(
        "--local", action="store_true", help="no survey: a frame of its own, the scaffold's baseline as unit"
    )


def run(arguments: argparse.Namespace) -> int:
    """Solve and write; 0 when done. Raises SkyfixError with what to do."""
    source: Path = arguments.input
    played = play_back(source, configured(arguments.config, source))
    say_what_is_not_used(played, source)
    scene = restricted(played.scene, arguments.cameras, arguments.from_s, arguments.to_s)
    solution = solve(scene, SolveOptions(local=arguments.local, evidence=True))
    report = write(solution, source.name, arguments.output)
    print(summary(solution, report, arguments.output))
    return 0


def configured(config: Path | None, source: Path) -> SurveyedSite | None:
    """The survey of a configuration, if one is given. Raises ConfigError."""
    if config is None:
        return None
    if source.is_dir():
        raise ConfigError(
            f"is for recordings; the positions of {source} stand in its site.toml",
            where="--config",
            action=f"correct {source / 'site.toml'}, and leave --config out",
        )
    loaded = load(config)
    return SurveyedSite(loaded.site.name, loaded.site.origin, with_survey(loaded, folder_of(config)))


def say_what_is_not_used(played: Played, source: Path) -> None:
    """Name on stderr what is left out. Raises ConfigError if nothing is left."""
    for refusal in played.refused:
        log.warning("%s: %s", source, refusal)
    for camera in played.without_lens:
        log.warning("%s: camera %s: nothing says what lens it has; left out", source, camera)
    if not played.scene.cameras:
        raise ConfigError("no camera with a lens in it", where=str(source), action="record a site with running boxes")


def restricted(scene: Scene, cameras: str | None, from_s: float | None, to_s: float | None) -> Scene:
    """The scene with only some cameras, or only a part of the time. Raises ConfigError for a camera it has not."""
    chosen = [camera.id for camera in scene.cameras] if cameras is None else cameras.split(",")
    known = {camera.id for camera in scene.cameras}
    for name in chosen:
        if name not in known:
            raise ConfigError(
                f"no camera {name!r}", where="--cameras", action=f"choose from {', '.join(sorted(known))}"
            )
    kept = {name: seen for name, seen in scene.observations.items() if name in chosen}
    if from_s is not None or to_s is not None:
        first = min((int(seen.t_unix_ns[0]) for seen in kept.values() if len(seen)), default=0)
        low = first + round((from_s or 0.0) * NS)
        high = first + round(to_s * NS) if to_s is not None else np.iinfo(np.int64).max
        kept = {name: _rows(seen, (seen.t_unix_ns >= low) & (seen.t_unix_ns <= high)) for name, seen in kept.items()}
    return replace(scene, cameras=tuple(c for c in scene.cameras if c.id in chosen), observations=kept)


def _rows(seen: Observations, keep: NDArray[np.bool_]) -> Observations:
    sigma = None if seen.sigma_px is None else seen.sigma_px[keep]
    return Observations(seen.t_unix_ns[keep], seen.pixels[keep], seen.track[keep], sigma)


def write(solution: Solution, source: str, folder: Path) -> Summary:
    """network.toml, trajectory.csv, report.html and report.json, each whole or not at all. source: solved from what."""
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / "network.toml", network.to_toml(solution.network).encode())
    write_trajectory(solution.trajectory, solution.network.origin, source, folder / "trajectory.csv")
    return write_report(solution, folder)


def summary(solution: Solution, report: Summary, folder: Path) -> str:
    """What a person at the terminal wants to know first."""
    found = solution.report
    lines = [
        f"{len(found.cameras)} cameras calibrated over {found.flight_s:.0f} s of flight, "
        f"residual {found.rms_px:.2f} px"
        + ("" if found.survey_rms_m is None else f", survey missed by {found.survey_rms_m:.3f} m"),
        f"grade {report.grade}: {report.verdict}",
        f"what would improve it most: {report.improvement}",
        *(f"left out: {name}: {why}" for name, why in found.left_out),
        *(f"found: {finding}" for finding in found.findings),
        f"weakest: {found.weakest_camera}, {found.weakest_sigma_m:.3f} m",
        f"results in {folder}",
    ]
    return "\n".join(lines)
