"""How the station stands, in the words that outputs get (outputs/output.py), and whether it is itself at fault.

The hazard is a station that says it is well while it can't do its work. Silent cameras are no fault of the station, and
are reported as such; a session that is not open or a loop that stands still are.
"""

from collections.abc import Iterable
from typing import Final

from calib.station.core.intake import CameraIntake
from calib.station.core.station import Station
from calib.station.outputs.output import CameraStanding, StationStanding
from edge.common.health import Check

SYNCED_S: Final = 0.02  # a clock bound good enough to be called synchronised: 0.4 m at 20 m/s
SYNCED_CAMERAS: Final = 2  # calibrated ones, for a target's time to be called so
VITAL: Final = ("loop", "core", "link")  # checks without which no true position is sent; a full disk is no such thing
STALLED_NS: Final = 10**9  # between two turns of the loop: its targets are of no use to anybody any more


class LoopWatch:
    """Whether the loop turns. `turned` costs a comparison; `check` is asked once a second."""

    def __init__(self, now_ns: int) -> None:
        self._last_ns, self._longest_ns = now_ns, 0

    def turned(self, now_ns: int) -> None:
        """The loop has come round."""
        self._longest_ns = max(self._longest_ns, now_ns - self._last_ns)
        self._last_ns = now_ns

    def check(self) -> Check:
        """How it was since the last time this was asked."""
        longest_ns, self._longest_ns = self._longest_ns, 0
        if longest_ns < STALLED_NS:
            return Check("loop", "ok", "turns")
        reason = f"stood still for {longest_ns * 1e-9:.1f} s"
        return Check("loop", "fail", reason, "look at the computer: memory, load, disk; end what else runs on it")


def fault_of(own: Iterable[Check]) -> str:
    """Why the station itself can't do its work, from the checks of its own parts; empty if it can."""
    failing = (check for check in own if check.level == "fail" and check.name in VITAL)
    return next((f"{check.name}: {check.reason}" for check in failing), "")


def disk_checks(**faults: str) -> list[Check]:
    """What can't be written, by name; nothing of what can."""
    return [Check(name, "warn", why, "look at the disk: space, rights") for name, why in faults.items() if why]


def synced(station: Station) -> bool:
    """Whether enough calibrated cameras say that their UTC is good."""
    boxes = station.intake.cameras
    return sum(_is_synced(boxes[camera]) for camera in station.calibration.trusted) >= SYNCED_CAMERAS


def standing_of(
    station: Station, now_ns: int, *, began_ns: int, latency_ms: float | None, fault: str
) -> StationStanding:
    """How the station is at now_ns. began_ns: its start. latency_ms: exposure to sent, 95th percentile."""
    stale_s, trusted, tracker = station.config.tracking.stale_s, station.calibration.trusted, station.tracker
    return StationStanding(
        t_unix_ns=station.now_unix_ns(now_ns),
        uptime_ms=(now_ns - began_ns) // 10**6,
        phase=station.standing.phase,
        reason=station.standing.reason,
        action=station.standing.action,
        fault=fault,
        cameras=tuple(
            CameraStanding(box.id, box.online(now_ns, stale_s), _is_synced(box), box.id in trusted)
            for box in station.intake.cameras.values()
        ),
        latency_ms=latency_ms,
        confirmed=0 if tracker is None else tracker.confirmed,
        tentative=0 if tracker is None else tracker.tentative,
    )


def _is_synced(box: CameraIntake) -> bool:
    return box.clock_bound_s is not None and box.clock_bound_s <= SYNCED_S
