"""Who a station is on a MAVLink network that it shares: from the configuration, or else from what it is installed as.

The hazard is the second station. Both send under the vehicle's system id, to be drawn at all, and with the same
components, addresses and callsigns they are one aircraft that jumps between two places, and whoever counts what is lost
counts each as the other's gap. So all of these differ by default, by the site, the folder and the machine; all can be
set; and whoever is heard under ours is said.
"""

import zlib
from collections import deque
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import common

from calib.station.config import MavlinkSection
from calib.station.outputs.mavlink.messages import ICAO_BAND, Identity
from edge.common.health import Check

# Component ids that MAVLink leaves to private networks for any purpose: no vehicle's part, its own ADS-B receiver say
# (156), has one of them, and no ground station takes one for an autopilot, a camera or a gimbal.
PRIVATE_COMPONENTS: Final = sorted(
    number for number, entry in common.enums["MAV_COMPONENT"].items() if entry.name.startswith("MAV_COMP_ID_USER")
)
ICAO_BLOCK: Final = (
    255  # addresses of one station: more than ever fly within the two minutes in which none is used again
)
ICAO_BLOCKS: Final = ICAO_BAND // ICAO_BLOCK
LETTERS: Final = "ABCDEFGHJKLMNPQRSTUVWXYZ23456789"  # without those that are mistaken for one another
MACHINE_ID: Final = Path("/etc/machine-id")
ECHOES: Final = 2048  # frames sent lately: what a router hands back from one endpoint to another is not a stranger's


def identity_of(options: MavlinkSection, site: str, folder: Path) -> Identity:
    """The station's identity. folder: of its configuration."""
    machine = MACHINE_ID.read_text(encoding="ascii").strip() if MACHINE_ID.exists() else ""
    number = zlib.crc32(f"{site}\n{folder.resolve()}\n{machine}".encode())
    letters = [letter for letter in site.upper() if letter in LETTERS][:2] or ["S"]
    own = "".join(LETTERS[number // 32**k % 32] for k in range(4 - len(letters)))
    first = options.icao_first or 1 + number % ICAO_BLOCKS * ICAO_BLOCK
    gcs, ecef = _components(options, number)
    return Identity(
        component_gcs=gcs,
        component_ecef=ecef,
        icao_first=first,
        icao_count=min(ICAO_BLOCK, ICAO_BAND - first + 1),
        callsign=options.callsign or "".join(letters) + own,
    )


def _components(options: MavlinkSection, number: int) -> tuple[int, int]:
    """For ground stations, and for ECEF. Two stations' differ both or neither: they take pairs."""
    pair = number // ICAO_BLOCKS % (len(PRIVATE_COMPONENTS) // 2)
    gcs, ecef = PRIVATE_COMPONENTS[2 * pair : 2 * pair + 2]
    if ecef == options.gcs_component or gcs == options.ecef_component:  # one is set, and is the other's default
        gcs, ecef = ecef, gcs
    return options.gcs_component or gcs, options.ecef_component or ecef


class Clashes:
    """Others who are heard under what is ours. found: what, in words; kept, for it does not mend itself."""

    def __init__(self, system: int, identity: Identity) -> None:
        self._system, self._identity = system, identity
        self._sent: deque[bytes] = deque(maxlen=ECHOES)
        self._known: set[bytes] = set()
        self.found: dict[str, str] = {}

    def sent(self, frames: list[bytes]) -> None:
        """Frames of our own: some may come back by another way."""
        for frame in frames:
            if len(self._sent) == ECHOES:
                self._known.discard(self._sent[0])
            self._sent.append(frame)
            self._known.add(frame)

    def hear(self, message: common.MAVLink_message) -> None:
        """Look at a message that came."""
        if bytes(message.get_msgbuf()) in self._known:
            return
        own = self._identity
        system, component = message.get_srcSystem(), message.get_srcComponent()
        if system == self._system and component in (own.component_gcs, own.component_ecef):
            self._note(
                f"somebody else sends as {system}/{component}, as this station does", "gcs_component and ecef_component"
            )
        if message.get_type() == "ADSB_VEHICLE":
            self._hear_aircraft(message, f"{system}/{component}")

    def _hear_aircraft(self, message: common.MAVLink_adsb_vehicle_message, sender: str) -> None:
        own, drawn = self._identity, str(message.callsign)
        if own.icao_first <= message.ICAO_address < own.icao_first + own.icao_count:
            self._note(f"{sender} draws aircraft under this station's addresses", "icao_first")
        if drawn.startswith(own.callsign) and drawn.removeprefix(own.callsign).isdecimal():
            self._note(f"{sender} calls aircraft {own.callsign}, as this station does", "callsign")

    def _note(self, what: str, keys: str) -> None:
        self.found[what] = f"give one of the two another mavlink.{keys.replace(' and ', ' and mavlink.')}"

    def check(self) -> Check:
        """Under what this station is heard, and who else is."""
        own = self._identity
        if self.found:
            return Check(
                "mavlink identity", "warn", "; ".join(self.found), "; ".join(dict.fromkeys(self.found.values()))
            )
        last = own.icao_first + own.icao_count - 1
        senders = f"{self._system}/{own.component_gcs} (gcs) and {self._system}/{own.component_ecef} (ecef)"
        drawn = f"aircraft {own.callsign} with addresses {own.icao_first} to {last}"
        return Check("mavlink identity", "ok", f"sends as {senders}, {drawn}")
