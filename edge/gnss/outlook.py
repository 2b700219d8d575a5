"""How a receiver stands, in one line: what a user of RTK looks at first, in the order in which they look.

The solution, satellites, age of the corrections, distance of the base they come from, sigma, and when the position can
be trusted. The hazard is the blank: what a receiver does not say is told as such, for a zero, or nothing at all, would
be taken for good news.
"""

import math
from typing import Final

from edge.gnss.averaging import MIN_DURATION_S
from edge.gnss.epoch import Epoch
from edge.gnss.gates import CONFIRMATIONS, QUALITY_NAMES
from edge.gnss.session import StaticSession, Surveyed

KILOMETRE_M: Final = 1000.0


def heard(session: StaticSession) -> str:
    """What the receiver itself says of its last epoch; empty before there is one."""
    return "" if session.latest is None else f"{_sky(session.latest)}, {_base(session)}"


def outlook(session: StaticSession, surveyed: Surveyed | None) -> str:
    """The line; empty before the first epoch."""
    said = heard(session)
    return "; ".join([said, _size(surveyed), _trust(session, surveyed)]) if said else ""


def _sky(epoch: Epoch) -> str:
    """The solution, the satellites, the age of the corrections."""
    parts = epoch.parts.values()
    quality = next((QUALITY_NAMES.get(part.quality, "unknown") for part in parts if part.quality is not None), "")
    satellites = max((part.satellites for part in parts if part.satellites), default=None)
    age_s = max((part.age_s for part in parts if part.age_s is not None), default=None)
    return ", ".join(
        [
            quality,
            "satellites not told" if satellites is None else f"{satellites} satellites",
            "age of corrections not told" if age_s is None else f"corrections {age_s:g} s old",
        ]
    )


def _base(session: StaticSession) -> str:
    """How far away the base is that its corrections come from."""
    told_m, set_m = session.told_baseline_m, session.set_baseline_m
    if told_m is not None:
        return f"base {_length(told_m)} away"
    return f"base {_length(set_m)} away (baseline_m)" if set_m else "baseline not told"


def _length(metres: float) -> str:
    return f"{metres / KILOMETRE_M:.1f} km" if metres >= KILOMETRE_M else f"{metres:.0f} m"


def _size(surveyed: Surveyed | None) -> str:
    if surveyed is None:
        return "no sigma yet"
    mean = surveyed.mean
    horizontal_mm = math.hypot(*mean.sigma_m[:2]) * 1000
    size = f"sigma {horizontal_mm:.0f} mm horizontal, {mean.sigma_m[2] * 1000:.0f} mm vertical"
    return f"{size} ({mean.samples} epochs in {mean.duration_s:.0f} s)"


def _trust(session: StaticSession, surveyed: Surveyed | None) -> str:
    """When its position can be used."""
    if surveyed is None and session.latest is not None and session.latest.fixed:
        return "not to be trusted"
    if surveyed is None:
        return f"to be trusted {MIN_DURATION_S + CONFIRMATIONS:.0f} s after it is RTK fixed"
    if not surveyed.mean.fault:
        return "can be trusted"
    if surveyed.trusted_in_s is None:
        return "not to be trusted"
    return f"to be trusted in {surveyed.trusted_in_s:.0f} s"
