"""A scene as the track folder that somebody gives to `base-station solve`."""

import tomllib
from pathlib import Path

import tomli_w

from calib.station.archive.simulated_folder import site_toml, write_folder
from tools.doubles.hazards.brought import Brought


def write(brought: Brought, folder: Path) -> None:
    """site.toml and tracks/, as somebody brings them."""
    write_folder(brought.simulated, folder)
    if not brought.says_origin:
        site = tomllib.loads(site_toml(brought.simulated.scene))
        del site["site"]["origin"]
        (folder / "site.toml").write_text(tomli_w.dumps(site), encoding="utf-8")
