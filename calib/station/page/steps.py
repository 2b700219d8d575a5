"""Survey, aim, check, calibrate, go: how far the station is, what is missing, and what to do next. Pure.

The hazard is a row of green lights that says nothing of the fifth step: every step has a reason in words, and one that
cannot be judged yet is yellow, not green.
"""

from dataclasses import dataclass
from typing import Final, Literal

from calib.station.config import MIN_CAMERAS
from calib.station.status import CameraStatus, StationStatus
from edge.messages import HealthLevel

Level = Literal["ok", "warn", "fail"]
SHARED_S: Final = 15  # s that two cameras saw something at once: enough to try (calibration.first_solve_s)


@dataclass(frozen=True)
class Step:
    """One step of setting up: green (ok), yellow (warn) or red (fail), why, and what to do."""

    name: str
    level: Level
    reason: str
    action: str = ""


def steps(status: StationStatus) -> list[Step]:
    """The five steps."""
    return [_survey(status), _aim(status), _check(status), _calibrate(status), _go(status)]


def next_step(found: list[Step]) -> Step | None:
    """The first step that is not green; None if all are."""
    return next((step for step in found if step.level != "ok"), None)


def _names(cameras: list[CameraStatus]) -> str:
    return ", ".join(camera.id for camera in cameras)


def _survey(status: StationStatus) -> Step:
    missing = [camera for camera in status.cameras if not camera.surveyed]
    count = len(status.cameras) - len(missing)
    if not missing:
        return Step("survey", "ok", f"all {count} cameras have a position")
    action = "base-station survey, or wait until the boxes' receivers have RTK"
    level: Level = "warn" if count >= MIN_CAMERAS else "fail"
    return Step("survey", level, f"no position of {_names(missing)}", action)


def _aim(status: StationStatus) -> Step:
    silent = [camera for camera in status.cameras if not camera.online]
    if silent:
        return Step("aim", "fail", f"no pictures from {_names(silent)}", "see Cameras: each says what is wrong with it")
    linked = {name for pair in status.pairs if pair.shared_s >= SHARED_S for name in (pair.one, pair.other)}
    alone = [camera for camera in status.cameras if camera.id not in linked and not camera.calibrated]
    if alone:
        reason = f"{_names(alone)}: not yet {SHARED_S} s of an object that another camera sees too"
        return Step("aim", "warn", reason, "fly, or turn the camera, until it and another see the same object")
    return Step("aim", "ok", "every camera shares an object with another")


def _check(status: StationStatus) -> Step:
    ranked: dict[HealthLevel, int] = {"ok": 0, "warn": 1, "fail": 2}
    wrong = [item for item in status.health.items if item.level != "ok" and item.name != "calibration"]
    if not wrong:
        return Step("check", "ok", "nothing is wrong")
    worst = max(wrong, key=lambda item: ranked[item.level])
    more = f", and {len(wrong) - 1} more" if len(wrong) > 1 else ""
    return Step("check", worst.level, f"{worst.name}: {worst.reason}{more}", worst.action)


def _calibrate(status: StationStatus) -> Step:
    if status.phase == "calibrated":
        return Step("calibrate", "ok", status.reason, status.action)
    return Step("calibrate", "warn" if status.solving else "fail", status.reason, status.action)


def _go(status: StationStatus) -> Step:
    if status.network is None:
        return Step("go", "fail", "nothing is sent before the station is calibrated", "calibrate first")
    if not status.endpoints:
        return Step("go", "fail", "no MAVLink endpoint is configured", "add [[mavlink.endpoint]] to the configuration")
    failing = [endpoint for endpoint in status.endpoints if endpoint.last_error and not endpoint.sent]
    if failing:
        reason = f"{failing[0].url}: {failing[0].last_error}"
        return Step("go", "warn", reason, "start the receiver, check the address")
    sent = sum(endpoint.sent for endpoint in status.endpoints)
    return Step("go", "ok", f"{len(status.targets)} targets, {sent} messages sent")
