"""The certificates of a new site: an authority, one for each machine, and each box's own beside its configuration."""

import datetime as dt
from pathlib import Path
from typing import Final

from calib.station.certs.authority import Authority
from calib.station.new_site import NewSite
from edge.common.atomic import write_atomically

FOLDER: Final = "certs"  # below the site's, and below each box's
PRIVATE: Final = "key.pem"


def certify(site: NewSite, folder: Path, *, days: int, now: dt.datetime) -> None:
    """An authority in folder/certs, and folder/<camera>/certs of each box; the base's stays below issued/base.

    Raises ConfigError if there is an authority already, OSError.
    """
    authority = Authority.create(folder / FOLDER, site.name, now)
    for machine in site.machines:
        issued = authority.issue(
            machine.name, machine.role, cameras=(), addresses=machine.addresses, days=days, now=now
        )
        if machine.role == "camera":
            carried = folder / machine.name / FOLDER
            carried.mkdir(parents=True, exist_ok=True, mode=0o700)
            for file in issued.folder.iterdir():
                write_atomically(carried / file.name, file.read_bytes(), mode=0o600 if file.name == PRIVATE else 0o644)
