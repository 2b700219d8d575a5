"""Who a station is on a MAVLink network that it shares: from the configuration, or else from what it is installed as.

The hazard is the second station. Both send under the vehicle's system id, to be drawn at all, and with the same
component, addresses and callsigns they are one aircraft that jumps between two places. So addresses and callsigns
differ by default, from the site, the folder and the machine; all can be set; and whoever is heard under ours is said.
"""

import zlib
from collections import deque
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import common

from calib.station.config import MavlinkSection
from calib.station.outputs.mavlink.messages import ICAO_BAND, Identity

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
    return Identity(
        component_gcs=options.gcs_component,
        component_ecef=options.ecef_component,
        icao_first=first,
        icao_count=min(ICAO_BLOCK, ICAO_BAND - first + 1),
        callsign=options.callsign or "".join(letters) + own,
    )


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
        own = self._identity
        source = (message.get_srcSystem(), message.get_srcComponent())
        ours = source[0] == self._system and source[1] in (own.component_gcs, own.component_ecef)
        taken = message.get_type() == "ADSB_VEHICLE" and (
            own.icao_first <= message.ICAO_address < own.icao_first + own.icao_count
        )
        if not (ours or taken) or bytes(message.get_msgbuf()) in self._known:
            return
        if ours:
            action = "give one of the two another mavlink.gcs_component and mavlink.ecef_component"
            self.found[f"another station sends as {source[0]}/{source[1]}, as this one does"] = action
        if taken:
            action = "give one of the two another mavlink.icao_first"
            self.found[f"{source[0]}/{source[1]} draws aircraft under this station's addresses"] = action
