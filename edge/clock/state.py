"""What is known of a clock: a bound that is true, or the admission that there is none."""

from dataclasses import dataclass
from typing import Literal

from edge.common.health import Check

Source = Literal["chrony", "kernel", "ptp", "assumed", "none"]


@dataclass(frozen=True)
class ClockState:
    """How far this machine's UTC may be off: bound_s, None if nobody knows. reason and action are for the operator.

    conflict: what other sources of time say otherwise; empty if none does.
    """

    bound_s: float | None
    source: Source
    synced: bool
    reason: str
    action: str = ""
    steps: int = 0
    conflict: str = ""


def unknown(source: Source, reason: str, action: str) -> ClockState:
    """The state of a clock of which nobody knows how far it is off."""
    return ClockState(None, source, False, reason, action)


def check_clock(state: ClockState, limit_s: float) -> Check:
    """What the operator sees: a failure over the limit or without a bound, a warning where two sources disagree."""
    if state.bound_s is None:
        return Check("clock", "fail", state.reason, state.action)
    if state.bound_s > limit_s:
        reason = f"UTC may be {state.bound_s * 1e3:.3g} ms off, the limit is {limit_s * 1e3:g} ms: {state.reason}"
        return Check("clock", "fail", reason, "wait, or give the machine a better source of time")
    if state.conflict:
        return Check("clock", "warn", f"{state.reason}; {state.conflict}", "see who is right: chronyc -n sources")
    if state.source == "assumed":
        return Check("clock", "warn", state.reason, 'set clock.source = "auto" and run chrony')
    return Check("clock", "ok", state.reason)
