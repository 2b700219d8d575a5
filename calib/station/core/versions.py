"""Which version of the program each box runs, and whether it is the station's.

Boxes of several versions work together, for what one does not know it ignores; but whoever looks for the cause of
something odd has to see the mix.
"""

from collections.abc import Iterable
from typing import Final

from calib.station.core.intake import CameraIntake
from edge.common.health import Check

SILENT: Final = "an older one, which does not say"


def check_versions(own: str, boxes: Iterable[CameraIntake]) -> Check:
    """A finding on the boxes whose health is known. own: the station's version."""
    said = {box.id: box.health.version or SILENT for box in boxes if box.health is not None}
    others = [f"{camera} runs {version}" for camera, version in said.items() if version != own]
    if not others:
        return Check("versions", "ok", f"{own} everywhere")
    action = "upgrade the others when there is time; what one does not know it ignores"
    return Check("versions", "warn", f"this is {own}; {', '.join(others)}", action)
