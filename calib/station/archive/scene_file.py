"""The description of a made-up flight, from its TOML file, or by the name of one that comes with the program."""

from pathlib import Path
from typing import Final

import calib.simulation
from calib.simulation.description import Simulation
from edge.common import settings
from edge.common.errors import ConfigError

SHIPPED: Final = Path(calib.simulation.__file__).parent / "scenes"


def shipped() -> list[str]:
    """The names of the scenes that come with the program."""
    return sorted(file.stem for file in SHIPPED.glob("*.toml"))


def located(scene: str) -> Path:
    """The file of a scene: a shipped one's name, or a path. Raises ConfigError where there is neither."""
    if Path(scene).is_file():
        return Path(scene)
    if scene in shipped():
        return SHIPPED / f"{scene}.toml"
    raise ConfigError("no such scene", where=scene, action=f"give a TOML file, or one of {', '.join(shipped())}")


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
