"""The clock as ptp4l tells it, and the box that is itself the site's grandmaster.

pmc makes a socket for the answer, in a place that a sandboxed service can't write: so it is told where. It asks on
ptp4l's read-only socket (linuxptp 3.1 and later), which any user may, and else on the one that is root's.
"""

import math
import os
import re
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

from edge.clock.chrony import read_chrony
from edge.clock.client import ask
from edge.clock.kernel import read_kernel
from edge.clock.state import ClockState, unknown

PTP_FLOOR_S: Final = 1e-5  # software time stamps and phc2sys add up to this
SOCKETS: Final = ("/var/run/ptp4lro", "/var/run/ptp4l")
QUESTIONS: Final = ("GET TIME_STATUS_NP", "GET CURRENT_DATA_SET", "GET PORT_DATA_SET")
GET_PTP: Final = "start ptp4l: deploy/chrony/PTP.md"


def of_ptp(answer: str) -> ClockState:
    """The state in the answer of pmc to GET TIME_STATUS_NP and GET CURRENT_DATA_SET; offsets there are nanoseconds."""
    reported = dict(re.findall(r"^\s+(\w+)\s+(\S+)\s*$", answer, flags=re.MULTILINE))
    try:
        present = reported["gmPresent"] == "true"
        offset_ns, delay_ns = float(reported["offsetFromMaster"]), float(reported["meanPathDelay"])
    except (KeyError, ValueError):
        return unknown("ptp", "ptp4l did not answer", GET_PTP)
    bound_s = (abs(offset_ns) + delay_ns / 2) * 1e-9 + PTP_FLOOR_S
    if not math.isfinite(bound_s) or bound_s < 0:
        return unknown("ptp", "ptp4l gave no number", "restart ptp4l")
    if not present:
        return unknown("ptp", "no PTP grandmaster on this network", "check the grandmaster and the switch")
    if offset_ns == delay_ns == 0.0:  # which no wire is: it has chosen whom to follow, and asked nothing yet
        return unknown("ptp", "ptp4l has measured nothing yet", "wait; if it stays so, check the switch")
    return ClockState(bound_s, "ptp", True, f"PTP within {bound_s * 1e6:.3g} us of the grandmaster")


def is_grandmaster(answer: str) -> bool:
    """Whether who answers is the grandmaster: a port of it is master, and the clock that it follows is its own."""
    own = re.search(r"^\s+([0-9a-f]{6}\.[0-9a-f]{4}\.[0-9a-f]{6})-\d+ seq", answer, flags=re.MULTILINE)
    followed = re.search(r"^\s+gmIdentity\s+(\S+)", answer, flags=re.MULTILINE)
    leads = re.search(r"^\s+portState\s+(MASTER|GRAND_MASTER)\s*$", answer, flags=re.MULTILINE)
    return own is not None and followed is not None and leads is not None and own[1] == followed[1]


def read_ptp(sockets: tuple[str, ...] = SOCKETS) -> ClockState:
    """The state as ptp4l tells it. It is the bound of the hardware clock: phc2sys must carry it to the system's.

    A grandmaster follows nobody by PTP: how good its UTC is, whoever sets its clock says.
    """
    answer = _answer(sockets)
    if not is_grandmaster(answer):
        return of_ptp(answer)
    own = read_chrony() or read_kernel()
    return replace(own, reason=f"this is the PTP grandmaster; {own.reason}")


def _answer(sockets: tuple[str, ...]) -> str:
    folder = Path(os.environ.get("RUNTIME_DIRECTORY", tempfile.gettempdir()).partition(":")[0])
    own = folder / f"pmc.{os.getpid()}"
    for socket in sockets:
        if not Path(socket).exists():
            continue
        answer = ask("pmc", "-u", "-b", "0", "-i", str(own), "-s", socket, *QUESTIONS)
        own.unlink(missing_ok=True)  # left behind by a pmc that was cut off
        if answer and "RESPONSE" in answer:
            return answer
    return ""
