"""The configurations of a new site: one base.toml and an edge.toml for each camera, which fit one another.

The hazard is the pair that does not: a site's name spelt in two ways, a camera that the base does not list, an address
that nobody listens on. All of it is silence in the field, so all of it is written from one place. Only what a site has
to say for itself is in them; everything else has a default, which deploy/GUIDE.md lists.
"""

import re
from dataclasses import dataclass
from typing import Final, NamedTuple

from calib.station.config import MAX_CAMERAS, MIN_CAMERAS
from edge.common.errors import ConfigError
from edge.link.access import Role

PORT: Final = 7447  # Zenoh's own
CERTS: Final = "/etc/skyfix/certs"
STATE_DIR: Final = "/var/lib/skyfix"
_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")  # as in a Zenoh key and in a certificate
_ADDRESS: Final = re.compile(r"[A-Za-z0-9.:-]+")


class Certified(NamedTuple):
    """Whom a certificate is for. addresses: where others dial it."""

    name: str
    role: Role
    addresses: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """What makes it by hand."""
        role = "" if self.role == "camera" else f" --role {self.role}"
        return f"base-station certs issue {self.name}{role}" + "".join(f" --address {each}" for each in self.addresses)


@dataclass(frozen=True)
class NewSite:
    """A site to be: its name, how many cameras, and the base's address as the boxes dial it.

    base_address: None for a bench, where base and boxes are one machine and nothing is encrypted.
    """

    name: str
    cameras: int
    base_address: str | None = None

    def __post_init__(self) -> None:
        """Raises ConfigError for what cannot be a site."""
        if not _NAME.fullmatch(self.name):
            raise ConfigError(f"{self.name!r} is no name", where="SITE", action="use letters, digits, _ and -")
        if not MIN_CAMERAS <= self.cameras <= MAX_CAMERAS:
            raise ConfigError(
                f"{self.cameras} cameras", where="--cameras", action=f"give {MIN_CAMERAS} to {MAX_CAMERAS}"
            )
        if self.base_address is not None and not _ADDRESS.fullmatch(self.base_address):
            raise ConfigError(f"{self.base_address!r} is no address", where="--base", action="give an IP or a name")

    @property
    def camera_ids(self) -> list[str]:
        """cam0, cam1, ..."""
        return [f"cam{k}" for k in range(self.cameras)]

    @property
    def machines(self) -> list[Certified]:
        """The base and each box; none for a bench, where nobody proves who he is."""
        if self.base_address is None:
            return []
        base = Certified("base", "station", (self.base_address,))
        return [base, *(Certified(camera, "camera") for camera in self.camera_ids)]

    @property
    def certificates(self) -> list[str]:
        """The commands that make every machine's certificate; none for a bench."""
        commands = [machine.command for machine in self.machines]
        return [f"base-station certs init {self.name}", *commands] if commands else []

    def files(self) -> dict[str, str]:
        """Text of each file by its path below the site's folder."""
        boxes = {f"{camera}/edge.toml": self._edge(k, camera) for k, camera in enumerate(self.camera_ids)}
        return {"base.toml": self._base()} | boxes

    def _base(self) -> str:
        cameras = "\n".join(f'[[camera]]\nid = "{camera}"' for camera in self.camera_ids)
        kept = STATE_DIR if self.base_address else "state"
        recordings = f"{STATE_DIR}/recordings" if self.base_address else "recordings"
        listen = f"tls/0.0.0.0:{PORT}" if self.base_address else f"tcp/127.0.0.1:{PORT}"
        return f"""\
# The base station of site {self.name}. `base-station check --config base.toml` says what is missing around it; every
# other key, with its meaning, is in deploy/GUIDE.md.

state_folder = "{kept}"       # the calibration: must survive a power cut

[site]
name = "{self.name}"                 # as in every edge.toml
# undulation_m = 47.6            # geoid above ellipsoid there, m (EGM96): profile "gcs" below needs it

# The order is the bit in MAVLink's camera masks: append, never insert. Positions: `base-station survey`, or the boxes'
# own receivers.
{cameras}

[link]
listen = ["{listen}"]   # every edge.toml dials it
{self._tls(listens=True)}
[recording]
folder = "{recordings}"

[[mavlink.endpoint]]
url = "udp:127.0.0.1:14550"      # who wants the positions
profile = ["ecef"]               # and "gcs" for a ground-control program's map
"""

    def _edge(self, number: int, camera: str) -> str:
        dialled = f"tls/{_bracketed(self.base_address)}" if self.base_address else "tcp/127.0.0.1"
        spool = f'\n[spool]                          # kept for a base that is out of reach\nfolder = "{STATE_DIR}"\n'
        return f"""\
# The box of camera {camera} at site {self.name}. `edge-node check --config edge.toml` says what is missing around it;
# every other key, with its meaning, is in deploy/GUIDE.md.

site = "{self.name}"                 # as in base.toml

[[camera]]
id = "{camera}"                      # as in base.toml
lens = "{camera}.lens.toml"          # beside this file: edge-node lens PICTURES --board 9x6 -o {camera}.lens.toml
# readout_s = 0.02               # first to last row of a rolling shutter

[camera.source]
path = "/dev/video{0 if self.base_address else number}"             # or rtsp://user@host/stream, or a video file

[link]
connect = ["{dialled}:{PORT}"]   # the base
{self._tls(listens=False)}
# [gnss]                         # where the box has a receiver
# device = "/dev/skyfix/gnss"
# lever_arm_m = [0.0, 0.0, 0.12] # antenna minus lens: east, north, up
{spool if self.base_address else ""}"""

    def _tls(self, *, listens: bool) -> str:
        if self.base_address is None:
            return ""
        access = f'access = "{CERTS}/access.json"\n' if listens else ""
        return (
            "\n[link.tls]                       # what `base-station certs issue` makes, copied there\n"
            f'authority = "{CERTS}/authority.pem"\n'
            f'certificate = "{CERTS}/certificate.pem"\n'
            f'key = "{CERTS}/key.pem"\n{access}'
        )


def _bracketed(address: str | None) -> str:
    """An IPv6 address stands in brackets before a port."""
    return f"[{address}]" if address and ":" in address else str(address)
