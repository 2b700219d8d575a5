"""The description of a made-up flight, from its TOML file."""

from pathlib import Path

from calib.simulation.description import Simulation
from edge.common import settings
from edge.common.errors import ConfigError


def load(path: Path) -> Simulation:
    """The scene of a TOML file. Raises ConfigError naming file and key."""
    scene = settings.load(path, Simulation)
    _refuse_duplicates([camera.id for camera in scene.camera], "camera id", path)
    _refuse_duplicates([thing.name for thing in scene.object], "object name", path)
    return scene


def _refuse_duplicates(names: list[str], what: str, path: Path) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(f"{what} {twice[0]!r} given twice", where=str(path), action="give each a name of its own")
