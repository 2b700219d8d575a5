"""What a live camera is asked for, and what is said where it does something else.

The hazard is the setting that is taken and not obeyed: another rate, another exposure, and nobody looks. So whatever
was asked for is read back, and what differs is told with both numbers.
"""

from dataclasses import dataclass
from typing import Final

from edge.capture.frame import Remark

OBEYED: Final = 0.1  # share by which a rate, exposure or gain may differ from what was asked: drivers have steps


@dataclass(frozen=True)
class CameraWish:
    """What a camera is asked for; None for what it likes. exposure_s sets it to manual; gain in the driver's units."""

    size_px: tuple[int, int] | None = None
    pixel_format: str | None = None
    fps: float | None = None
    exposure_s: float | None = None
    gain: float | None = None


def not_obeyed(what: str, asked: float, got: float, action: str) -> list[Remark]:
    """A remark that what was asked for, with its number in the sentence `what`, is not what the camera has; or none."""
    if abs(got - asked) <= OBEYED * max(abs(asked), 1e-9):
        return []
    return [Remark(f"{what.format(asked)} was asked for, it has {got:g}", action)]
