"""Survey, aim, check, calibrate, go: how far the station is, what is missing, and what to do next. Pure.

The hazard is a row of green lights that says nothing of the fifth step: every step has a reason in words, and one that
cannot be judged yet is yellow, not green.
"""

from dataclasses import dataclass
from typing import Literal

from calib.station.config import MIN_CAMERAS
from calib.station.status.status import CameraStatus, StationStatus
from edge.common.health import HealthLevel

Level = Literal["ok", "warn", "fail"]


@dataclass(frozen=True)
class ChecklistStep:
    """One step of setting up: green (ok), yellow (warn) or red (fail), why, and what to do."""

    name: str
    level: Level
    reason: str
    action: str = ""


def steps(status: StationStatus) -> list[ChecklistStep]:
    """The five steps."""
    return [_survey(status), _aim(status), _check(status), _calibrate(status), _go(status)]


def next_step(found: list[ChecklistStep]) -> ChecklistStep | None:
    """The first step that is not green; None if all are."""
    return next((step for step in found if step.level != "ok"), None)


def _names(cameras: list[CameraStatus]) -> str:
    return ", ".join(camera.id for camera in cameras)


def _survey(status: StationStatus) -> ChecklistStep:
    missing = [camera for camera in status.cameras if not camera.surveyed]
    count = len(status.cameras) - len(missing)
    if not missing:
        return ChecklistStep("survey", "ok", f"all {count} cameras have a position{_frame(status)}")
    action = "base-station survey, or wait until the boxes' receivers have RTK"
    level: Level = "warn" if count >= MIN_CAMERAS else "fail"
    return ChecklistStep("survey", level, f"no position of {_names(missing)}", action)


def _frame(status: StationStatus) -> str:
    """What is known of the positions' frame."""
    if status.frame_sigma_m:
        return f"; their frame is {status.frame}: every sigma that is sent holds {status.frame_sigma_m:g} m for it"
    return f", in {status.frame}"


def _aim(status: StationStatus) -> ChecklistStep:
    silent = [camera for camera in status.cameras if not camera.online]
    if silent:
        return ChecklistStep(
            "aim", "fail", f"no pictures from {_names(silent)}", "see Cameras: each says what is wrong with it"
        )
    linked = {name for pair in status.pairs if pair.shared_s >= status.first_solve_s for name in (pair.one, pair.other)}
    alone = [camera for camera in status.cameras if camera.id not in linked and not camera.calibrated]
    if alone:
        reason = f"{_names(alone)}: not yet {status.first_solve_s:g} s of an object that another camera sees too"
        return ChecklistStep("aim", "warn", reason, "fly, or turn the camera, until it and another see the same object")
    return ChecklistStep("aim", "ok", "every camera shares an object with another")


def _check(status: StationStatus) -> ChecklistStep:
    ranked: dict[HealthLevel, int] = {"ok": 0, "warn": 1, "fail": 2}
    wrong = [item for item in status.health.items if item.level != "ok" and item.name != "calibration"]
    if not wrong:
        return ChecklistStep("check", "ok", "nothing is wrong")
    worst = max(wrong, key=lambda item: ranked[item.level])
    more = f", and {len(wrong) - 1} more" if len(wrong) > 1 else ""
    return ChecklistStep("check", worst.level, f"{worst.name}: {worst.reason}{more}", worst.action)


def _calibrate(status: StationStatus) -> ChecklistStep:
    if status.phase == "calibrated":
        return ChecklistStep("calibrate", "ok", status.reason, status.action)
    return ChecklistStep("calibrate", "warn" if status.solving else "fail", status.reason, status.action)


def _go(status: StationStatus) -> ChecklistStep:
    if status.network is None:
        return ChecklistStep("go", "fail", "nothing is sent before the station is calibrated", "calibrate first")
    if not status.endpoints:
        return ChecklistStep(
            "go", "fail", "no output is configured", "add [[mavlink.endpoint]] or [output.NAME] to the configuration"
        )
    failing = [endpoint for endpoint in status.endpoints if endpoint.last_error and not endpoint.sent]
    if failing:
        reason = f"{failing[0].url}: {failing[0].last_error}"
        return ChecklistStep("go", "warn", reason, "start the receiver, check the address")
    sent = sum(endpoint.sent for endpoint in status.endpoints)
    return ChecklistStep("go", "ok", f"{len(status.targets)} targets, {sent} messages sent")
