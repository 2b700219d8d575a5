"""A scene file (calib/simulation/description.py) as somebody brings it: what is wrong in it stands in its keys."""

from pathlib import Path

from calib.simulation.simulation import simulate
from calib.solving.found import Cause
from calib.station.archive.scene_file import load
from tools.doubles.hazards.brought import Brought, Fault


def brought_from(path: Path, trial: int = 0) -> Brought:
    """The scene of a TOML file with a trial's errors; healthy is not known. Raises ConfigError naming file and key."""
    simulation = load(path)
    moved = tuple(camera.id for camera in simulation.camera if camera.bump)
    stepped = tuple(camera.id for camera in simulation.camera if camera.clock_step)
    faults = tuple(Fault(cause, names) for cause, names in ((Cause.POSE, moved), (Cause.CLOCK, stepped)) if names)
    return Brought(simulate(simulation, trial), faults, note=path.stem)
