"""How hot the box is. A box in the sun slows itself down, loses frames, and says nothing of it."""

from pathlib import Path
from typing import Final

from edge.common.health import Check, HealthLevel

ZONES: Final = Path("/sys/class/thermal")
WARM_C: Final = 75.0  # a Raspberry Pi slows down at 80
HOT_C: Final = 85.0  # and stops at 85


def check_temperature(zones: Path = ZONES) -> list[Check]:
    """The hottest of the kernel's thermal zones; nothing where there are none (virtual machines)."""
    found = [reading for zone in sorted(zones.glob("thermal_zone*/temp")) if (reading := _celsius(zone)) is not None]
    if not found:
        return []
    hottest = max(found)
    level: HealthLevel = "fail" if hottest >= HOT_C else "warn" if hottest >= WARM_C else "ok"
    action = "" if level == "ok" else "give it shade and air, or less to do"
    return [Check("temperature", level, f"{hottest:.0f} °C", action)]


def _celsius(file: Path) -> float | None:
    try:
        return int(file.read_text()) / 1000
    except (OSError, ValueError):  # a zone that is switched off answers with an error
        return None
