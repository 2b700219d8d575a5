"""A process that steps back behind what is live.

The hazard is a courtesy that kills: a unit's system call filter, or a container's, may forbid `setpriority`, and then
the solver or the page would die at its first line. Both do their work without it, only less politely.
"""

import logging
import os

log = logging.getLogger(__name__)


def step_back(niceness: int) -> bool:
    """Add so much to this process's niceness. False, with a warning, where the system forbids it."""
    try:
        os.nice(niceness)
    except OSError as error:
        log.warning(
            "not allowed to run behind what is live (setpriority: %s); it goes on at the same priority: "
            "add SystemCallFilter=setpriority to the service",
            error.strerror,
        )
        return False
    return True
