"""The station's own clock, which most sites' boxes follow.

No position waits for it: stamps are the boxes'. But a base that is off, or follows nobody, takes all its boxes along,
and each of them finds that all is well. So it is looked at as on a box, and told; as a warning, for what is sent is
judged by the boxes' own bounds.
"""

from dataclasses import replace

from edge.clock.settings import ClockConfig
from edge.clock.state import ClockState, check_clock
from edge.common.health import Check


def check_own_clock(state: ClockState, config: ClockConfig) -> Check:
    """Whom this machine follows and how far it may be off."""
    check = check_clock(state, config.limit_s)
    return replace(check, level="warn") if check.level == "fail" else check
