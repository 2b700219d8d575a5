"""`base-station simulate`: a seeded scene as a track folder, with its truth."""

import argparse
from pathlib import Path

from calib.simulation.simulation import simulate
from calib.station.archive.scene_file import load, located, shipped
from calib.station.archive.simulated_folder import write_folder
from edge.common.errors import SkyfixError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station simulate`."""
    parser.epilog = "calib/simulation/description.py lists every key of a scene."
    parser.add_argument("scene", help=f"the scene's TOML file, or one that comes with it: {', '.join(shipped())}")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER", help="track folder to write")
    parser.add_argument("--trial", type=int, default=0, metavar="N", help="draw the errors of another trial")


def run(arguments: argparse.Namespace) -> int:
    """Read the scene, simulate it, write it. Raises ConfigError for the scene, SkyfixError for the folder."""
    scene = load(located(arguments.scene))
    simulated = simulate(scene, arguments.trial)
    try:
        write_folder(simulated, arguments.output, scene.truth_rate_hz)
    except OSError as error:
        raise SkyfixError(
            f"cannot be written ({error.strerror})", where=str(arguments.output), action="choose another -o"
        ) from error
    counts = ", ".join(f"{camera} {len(rows.track)}" for camera, rows in simulated.rows.items())
    print(f"{scene.name}, seed {scene.seed}, trial {arguments.trial}: {simulated.duration_s:g} s; rows: {counts}")
    print(f"written to {arguments.output}")
    return 0
