"""Write a seeded scene as a track folder with its truth: `python -m tools.simulate scene.toml -o out/scene`."""

import argparse
import sys
from pathlib import Path

from edge.errors import SkyfixError
from tools.scenes.description import load
from tools.scenes.folder import write_folder
from tools.scenes.simulation import Simulated, simulate

__all__ = ["Simulated", "main", "simulate"]


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tools.simulate",
        description=__doc__,
        epilog="tools/scenes/description.py lists every key of a scene; deploy/scenes holds examples.",
    )
    parser.add_argument("scene", type=Path, help="the scene's TOML file")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER", help="track folder to write")
    parser.add_argument("--trial", type=int, default=0, metavar="N", help="draw the errors of another trial")
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Read the scene, simulate it, write it."""
    arguments = _arguments(argv)
    try:
        scene = load(arguments.scene)
        simulated = simulate(scene, arguments.trial)
        write_folder(simulated, arguments.output, scene.truth_rate_hz)
    except SkyfixError as error:
        print(error, file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{arguments.output}: cannot be written ({error.strerror}); choose another -o", file=sys.stderr)
        return 1
    counts = ", ".join(f"{camera} {len(rows.track)}" for camera, rows in simulated.rows.items())
    print(f"{scene.name}, seed {scene.seed}, trial {arguments.trial}: {simulated.duration_s:g} s; rows: {counts}")
    print(f"written to {arguments.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
