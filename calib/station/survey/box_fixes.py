"""The survey by the boxes' own receivers: what they have averaged, taken over as it is.

Two hazards. Two programs at one port: the boxes dial the station, and only one program can be dialled there. So while
the station runs it is asked, and what the boxes keep for latecomers comes through it; else this program listens in its
place. And two readers of one message: what the station would refuse (a float solution, say) is not stored either, for
it is the station's own intake that judges here.
And a station that runs remembers what it was told before: what it doubts is stored only if the operator says so.
"""

import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from calib.station.core.intake import Intake
from calib.station.core.positions import check_offset
from calib.station.status.asking import running_station
from calib.station.survey import edit
from calib.station.survey.call import SurveyCall, agreed, not_replaced, replaced, store
from calib.station.survey.store import Survey
from edge.common.errors import ConfigError
from edge.common.units import NS
from edge.gnss.kept_fix import WHAT_TO_DO
from edge.link.inbox import Inbox, Received
from edge.link.link import Link
from edge.link.ports import beside_listener
from edge.messages import Fix, camera_key, camera_of_key

LOOK_S: Final = 0.5  # between two looks at whether the session is open
HEALTH_WAIT_S: Final = 2.5  # a box says how it is once a second
LONGEST_AGE_S: Final = 60.0  # of a fix whose box has something to say of its receiver


@dataclass(frozen=True)
class BoxFixes:
    """What came: the fix of each camera, and why those that sent none fit for a survey are left out."""

    fixes: dict[str, Fix]
    refused: dict[str, str]


def take_boxes(call: SurveyCall) -> int:
    """Workflow one: a receiver on each box. Raises ConfigError if no box sends a position."""
    found, doubts = fixes_of(call), _doubts(call)
    survey, kept = call.survey, []
    for camera, fix in sorted(found.fixes.items()):
        if (doubt := doubts.get(camera)) and not (call.args.yes or agreed(call, f"{camera}: {doubt}; store it?")):
            print(f"{camera}: not stored: {doubt}; {WHAT_TO_DO}", file=sys.stderr)
            kept.append(camera)
            continue
        entered = _entered(survey, camera, fix)
        if replaced(call, entered, camera):
            survey = entered
        else:
            print(not_replaced(camera), file=sys.stderr)
            kept.append(camera)
    if not set(found.fixes) - set(kept):
        return 1
    names = [camera.id for camera in call.config.camera]
    for camera in (name for name in names if name not in found.fixes):
        print(f"{camera}: {found.refused.get(camera, 'no position came')}", file=sys.stderr)
    return store(call, survey) or int(bool(kept))


def _doubts(call: SurveyCall) -> dict[str, str]:
    """What the station that runs here, if one does, has against the position of each camera."""
    running = running_station(call.config, Path(call.args.config).parent)
    if running is None or running.site != call.config.site.name:
        return {}
    against = {item.name: item.reason for item in running.health.items if item.level == "fail"}
    names = [camera.id for camera in call.config.camera]
    return {
        name: f"the station that runs says: {against[at]}" for name in names if (at := f"position {name}") in against
    }


def fixes_of(call: SurveyCall) -> BoxFixes:
    """The newest fix of every box that answers in time. Raises ConfigError if none does."""
    names = [camera.id for camera in call.config.camera]
    intake = Intake(names, where=str(call.args.config))
    settings = beside_listener(call.config.link)
    until_s = time.monotonic() + call.args.seconds
    with Link(settings, name="survey") as link:
        site = call.config.site.name
        inbox, said = link.watch_state(camera_key(site, "*", "fix")), link.subscribe(camera_key(site, "*", "health"))
        while _missing(intake) and (left_s := until_s - time.monotonic()) > 0:
            received = inbox.get(min(left_s, LOOK_S))
            camera = intake.cameras.get(camera_of_key(received.key) or "") if received is not None else None
            if received is not None and camera is not None:
                intake.fix(camera, received.payload, received.t_monotonic_ns)
        _hear_health(intake, said)
        error = link.error
    _look_at_health(intake)
    fixes = {name: box.fix for name, box in intake.cameras.items() if box.fix is not None}
    refused = {name: "; ".join(fault[0] for fault in box.faults.values()) for name, box in intake.cameras.items()}
    refused = {name: why for name, why in refused.items() if why}
    if not fixes:
        raise _nothing(settings.connect, error, refused)
    return BoxFixes(fixes, refused)


def _hear_health(intake: Intake, said: Inbox[Received]) -> None:
    """How each box that has sent a position is: it says so once a second."""
    until_s = time.monotonic() + HEALTH_WAIT_S
    while (left_s := until_s - time.monotonic()) > 0:
        if all(box.health is not None for box in intake.cameras.values() if box.fix is not None):
            return
        received = said.get(left_s)
        camera = intake.cameras.get(camera_of_key(received.key) or "") if received is not None else None
        if received is not None and camera is not None:
            intake.health(camera, received.payload, received.t_monotonic_ns)


def _look_at_health(intake: Intake) -> None:
    """A position that its box's own receiver speaks against, or that it has not confirmed lately, is not taken."""
    for box in intake.cameras.values():
        gnss = box.said_of("gnss")
        if box.fix is None or box.health is None or gnss is None or gnss.level == "ok":
            continue
        age_s = (box.health.t_unix_ns - box.fix.t_unix_ns) / NS
        if gnss.level == "fail" or age_s > LONGEST_AGE_S:
            old = f" and it is {age_s:.0f} s old" if age_s > LONGEST_AGE_S else ""
            why = f"its box's receiver does not stand by its position ({gnss.reason}){old}"
            box.fault("receiver", why, gnss.action, 0)
            box.fix = None


def _missing(intake: Intake) -> bool:
    return any(box.fix is None for box in intake.cameras.values())


def _nothing(asked: tuple[str, ...], error: str, refused: dict[str, str]) -> ConfigError:
    through = f" through what listens on {', '.join(asked)}" if asked else ""
    whys = [f"{name}: {why}" for name, why in refused.items()] + ([error] if error else [])
    reason = f" ({'; '.join(whys)})" if whys else ""
    return ConfigError(
        f"no box has sent a position{through}{reason}",
        where="survey boxes",
        action="see `edge-node check` on the boxes, wait, and repeat it with more --seconds",
    )


def _entered(survey: Survey, camera: str, fix: Fix) -> Survey:
    print(f"{camera}: {fix.samples} epochs, sigma {math.hypot(*fix.sigma_m[:2]) * 1000:.0f} mm horizontal")
    for check in check_offset(camera, fix):
        print(f"{camera}: {check.reason}; {check.action}", file=sys.stderr)
    return edit.enter_fix(survey, camera, fix)
