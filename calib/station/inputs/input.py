"""What an input is: a source of positions beside the boxes, as `base-station survey` reads one on a tripod.

The hazard is a source that is trusted because it speaks. So every one states in the same words how it is, why a
position is not to be used, and what was refused; who reads it never asks which make it is, or over what it came.
"""

from typing import Protocol

from edge.gnss.diagnosis import ReceiverStatus
from edge.gnss.session import Surveyed


class PositionInput(Protocol):
    """One source of positions, open, that stands still while it is read. Only `wait` blocks."""

    def restart(self) -> None:
        """Forget the positions so far: another tripod, or another occupation."""

    def wait(self, timeout_s: float) -> bool:
        """Wait for news; whether there is any."""

    def surveyed(self) -> Surveyed | None:
        """The position as averaged so far, with its fault if it has one; None while there is none."""

    def status(self) -> ReceiverStatus:
        """State, reason and next action; what was refused is in its counters."""
