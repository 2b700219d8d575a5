"""The survey's own file: every occupation as it was measured, and the positions that follow from them.

The hazard is a number whose origin nobody remembers. So the raw coordinates stay for good, each with its antenna, its
time and its sigma; the file says which frame, epoch and correction service they are in; and the positions the base
station reads (`position`, `position_sigma`, of the lens) are derived from the raw ones anew whenever the file changes.
"""

from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
import tomli_w
from msgspec import Meta
from msgspec.structs import replace

from edge.common.atomic import write_atomically
from edge.common.errors import ConfigError
from edge.common.settings import load
from edge.messages import Name, TimeNs

# What the file begins with: TOML keeps no comment through a rewrite, so this one is written every time.
HEADER: Final = "# Written by `base-station survey`. Raw coordinates are never changed; positions follow from them.\n\n"

Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Geodetic = tuple[Latitude, Longitude, Annotated[float, Meta(ge=-1000, le=10000)]]
Sigma = Annotated[float, Meta(ge=0, le=1000)]
Sigmas = tuple[Sigma, Sigma, Sigma]
LARGEST_SIGMA_M: Final = 1000.0
Positive = Annotated[float, Meta(gt=0, le=LARGEST_SIGMA_M)]


class Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """A table of the file. Unknown keys in it are refused."""


class AntennaTable(Table, frozen=True, kw_only=True):
    """As calib.survey.Antenna."""

    above_lens_m: Annotated[float, Meta(ge=-3, le=10)]
    measured_to: Literal["phase-centre", "ARP"]
    position_of: Literal["phase-centre", "ARP"] = "phase-centre"
    phase_centre_above_arp_m: Annotated[float, Meta(ge=0, le=0.5)] | None = None
    beside_lens_m: Annotated[float, Meta(ge=0, le=0.01)] = 0.0
    model: str = ""
    measured_by: str = ""


class OccupationTable(Table, frozen=True, kw_only=True):
    """One static session: the antenna's position as it was measured, and the parts of its error."""

    t_unix_ns: TimeNs
    duration_s: Annotated[float, Meta(ge=0, le=1e6)]
    samples: Annotated[int, Meta(ge=1)]
    position: Geodetic
    scatter_m: Sigmas
    floor_m: Sigmas
    fixed_m: Sigmas
    antenna: AntennaTable


class EnteredTable(Table, frozen=True, kw_only=True):
    """A lens position from elsewhere: typed in, from a CSV file, or a box's own average."""

    position: Geodetic
    sigma: tuple[Positive, Positive, Positive]
    source: str


class CameraTable(Table, frozen=True, kw_only=True):
    """One tripod. position and position_sigma: derived, of the lens; what the base station reads."""

    id: Name
    position: Geodetic | None = None
    position_sigma: tuple[Positive, Positive, Positive] | None = None
    entered: EnteredTable | None = None
    occupation: tuple[OccupationTable, ...] = ()


class TapeTable(Table, frozen=True, kw_only=True):
    """A taped distance between two lenses. trusted: ends that the operator knows to be right though it contradicts."""

    first: Name
    second: Name
    distance_m: Annotated[float, Meta(gt=0, le=1000)]
    sigma_m: Annotated[float, Meta(gt=0, le=1)] = 0.01
    trusted: tuple[Name, ...] = ()


class ClosureTable(Table, frozen=True, kw_only=True):
    """The rover came back to a tripod and it was elsewhere: off_m from where it was, east, north, up.

    cameras: the tripods occupied since, one or more of which are as false as that.
    """

    camera: Name
    t_unix_ns: TimeNs
    off_m: tuple[float, float, float]
    cameras: tuple[Name, ...]


class SurveySite(Table, frozen=True, kw_only=True):
    """What holds for all points: raw_frame and epoch of the raw coordinates; convert_to a frame, if one is wanted."""

    name: Name
    raw_frame: str = "unknown"
    epoch: Annotated[float, Meta(ge=1980, le=2100)] | None = None
    service: str = ""
    base: str = ""
    convert_to: str | None = None
    frame: str = "unknown"
    frame_note: str = "passed through"
    frame_sigma_m: Sigma = 0.0
    shift_enu_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift_note: str = ""


class Survey(Table, frozen=True, kw_only=True):
    """The whole file."""

    site: SurveySite
    camera: tuple[CameraTable, ...] = ()
    tape: tuple[TapeTable, ...] = ()
    closure: tuple[ClosureTable, ...] = ()

    def of(self, camera: str) -> CameraTable | None:
        """The tripod of that camera, if it is in the file."""
        return next((table for table in self.camera if table.id == camera), None)

    def with_camera(self, table: CameraTable) -> "Survey":
        """This survey with one tripod added or replaced, its order kept."""
        if self.of(table.id) is None:
            return replace(self, camera=(*self.camera, table))
        return replace(self, camera=tuple(table if old.id == table.id else old for old in self.camera))


def load_survey(path: Path) -> Survey:
    """The survey in a file. Raises ConfigError naming file and key."""
    survey = load(path, Survey)
    names = [table.id for table in survey.camera]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"camera {name} is there twice", where=str(path), action="remove one of them")
    return survey


def save_survey(survey: Survey, path: Path) -> None:
    """Write the file so that a power cut leaves the old or the new one."""
    write_atomically(path, (HEADER + tomli_w.dumps(msgspec.to_builtins(survey))).encode())
