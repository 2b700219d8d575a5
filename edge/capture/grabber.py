"""The part of OpenCV's captures that live sources use, and what is said when one gives nothing more."""

from typing import Any, Protocol

from edge.capture.address import shown
from edge.common.errors import SourceError


class Grabber(Protocol):
    """The part of cv2.VideoCapture that is used here; a test can stand in for a driver."""

    def isOpened(self) -> bool:
        """Whether it opened."""

    def grab(self) -> bool:
        """Go to the next frame."""

    def retrieve(self) -> tuple[bool, Any]:
        """The frame's pixels."""

    def get(self, prop: int, /) -> float:
        """A property."""

    def set(self, prop: int, value: float, /) -> bool:
        """Set a property."""

    def release(self) -> None:
        """Close it."""


def dead(path: str) -> SourceError:
    """The error of a camera that gives no more frames."""
    action = "check cable and power; it is opened again by itself"
    return SourceError("the camera gives no more frames", where=shown(path), action=action)
