"""The clock as chronyd tells it.

Two hazards beside the daemon that is not there. A base with no source serves its own clock (`local stratum 10 orphan`)
so that its boxes agree with each other, and claims to be right to the nanosecond: nobody there knows UTC. And a machine
that hears the base and the internet may find that they differ: chronyd believes one of them, and tells nobody.
"""

import math
from dataclasses import replace
from typing import Final

from edge.clock.client import ask
from edge.clock.state import ClockState, unknown

LOCAL_REFID: Final = "7F7F0101"  # chronyd's own clock, configured with `local`
LOCAL_STRATUM: Final = 10  # of that clock in deploy/chrony; no chain of real servers is so long
GET_UTC: Final = "give the base a source of UTC: deploy/chrony/README.md"
FALSETICKER: Final = "x"  # in `chronyc -c sources`: contradicts those that are believed
SELECTED: Final = "*"


def of_chrony(tracking: str) -> ClockState:
    """The state in one line of `chronyc -c tracking`.

    Bound as ClockBound (Amazon, 2021) computes it: |system offset| + root dispersion + root delay / 2.
    """
    fields = tracking.strip().split(",")
    try:
        name, stratum = fields[1] or fields[0], int(fields[2])
        offset_s, delay_s, dispersion_s = float(fields[4]), float(fields[10]), float(fields[11])
        leap = fields[13]
    except (IndexError, ValueError):
        return unknown("chrony", f"chronyc said {tracking.strip()[:80]!r}", "check that chronyd and chronyc match")
    if leap == "Not synchronised":
        return unknown("chrony", "chronyd has no source it trusts", "check its sources: chronyc sources -v")
    if fields[0] == LOCAL_REFID:
        return unknown("chrony", "chronyd follows nobody and serves its own clock: nobody here knows UTC", GET_UTC)
    if stratum > LOCAL_STRATUM:
        return unknown("chrony", f"chrony follows {name}, which follows nobody: nobody here knows UTC", GET_UTC)
    bound_s = abs(offset_s) + dispersion_s + delay_s / 2
    if not (math.isfinite(bound_s) and dispersion_s >= 0 and delay_s >= 0):
        return unknown("chrony", f"chronyc said {tracking.strip()[:80]!r}", "restart chronyd")
    return ClockState(bound_s, "chrony", True, f"chrony follows {name} within {bound_s * 1e3:.3g} ms")


def conflict_of(sources: str) -> str:
    """Who contradicts the source that is followed, in the lines of `chronyc -c sources`; empty if nobody does."""
    offsets_s: dict[str, float] = {}
    selected_s = 0.0
    for fields in (line.split(",") for line in sources.splitlines()):
        try:
            state, name, offset_s = fields[1], fields[2], float(fields[7])
        except (IndexError, ValueError):
            continue
        if state == SELECTED:
            selected_s = offset_s
        elif state == FALSETICKER and math.isfinite(offset_s):
            offsets_s[name] = offset_s
    said = [f"{name} says {abs(offset_s - selected_s) * 1e3:.3g} ms otherwise" for name, offset_s in offsets_s.items()]
    return ", ".join(said)


def read_chrony(*options: str) -> ClockState | None:
    """The state as chronyd tells it; None if there is no chronyd. options: as chronyc's, such as -p PORT."""
    tracking = ask("chronyc", *options, "-c", "-n", "tracking")
    if tracking is None:
        return None
    return replace(of_chrony(tracking), conflict=conflict_of(ask("chronyc", *options, "-c", "-n", "sources") or ""))
