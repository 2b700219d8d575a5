"""The parts of `base-station survey` that happen in the field: the rover on its tripods, and the boxes' own receivers.

The hazard is a wrong position that is stored unnoticed. So nothing is written before it has been compared with what is
there already, the operator sees the comparison before accepting, and what was rejected is said with its reason.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace as replaced
from pathlib import Path

from calib.errors import CalibrationError
from calib.station.config import BaseConfig
from calib.station.survey import edit
from calib.station.survey.rover import occupy, wait_for_lost_fix
from calib.station.survey.store import AntennaTable, OccupationTable, Survey, antenna_of, save_survey
from edge.common.errors import ConfigError
from edge.common.settings import build
from edge.config import GnssConfig
from edge.gnss.receiver import Receiver
from edge.link.link import Link
from edge.messages import Fix, camera_key, camera_of_key, decode

Ask = Callable[[str], str]


@dataclass(frozen=True)
class SurveyJob:
    """One call of the command: its arguments, the station's configuration, the survey and where it is kept."""

    args: argparse.Namespace
    config: BaseConfig
    survey: Survey
    path: Path
    ask: Ask = input


def store(job: SurveyJob, survey: Survey) -> int:
    save_survey(survey, job.path)
    print(edit.describe(survey))
    print(f"stored in {job.path}")
    return 0


def configured(job: SurveyJob, camera: str) -> None:
    names = [each.id for each in job.config.camera]
    if camera not in names:
        raise ConfigError(
            f"no camera {camera}", where=str(job.args.config), action=f"configured are: {', '.join(names)}"
        )


def occupy_one(job: SurveyJob) -> int:
    configured(job, job.args.camera)
    antenna = _antenna(job)
    receiver = Receiver(_receiver_config(job))
    receiver.start()
    try:
        _occupy_tripod(job, receiver, antenna, job.args.camera)
    finally:
        receiver.stop()
    return 0


def rover_round(job: SurveyJob) -> int:
    """The whole round: every camera in the order of the operator's choice, and back to the first."""
    antenna = _antenna(job)
    receiver = Receiver(_receiver_config(job))
    receiver.start()
    first: str | None = None
    try:
        while camera := _choose(job, first):
            try:
                job = replaced(job, survey=_occupy_tripod(job, receiver, antenna, camera))
            except CalibrationError as error:
                print(f"not stored: {error}", file=sys.stderr)
                continue
            first = first or camera
    finally:
        receiver.stop()
    closure = edit.closure_of(job.survey)
    print(f"loop closure on {closure[0]} {closure[1]}" if closure else "the round was not closed on its first tripod")
    return 0 if closure and not closure[1].apart.too_far else 1


def _choose(job: SurveyJob, first: str | None) -> str:
    """The next tripod's camera; empty when the operator is done."""
    names = [camera.id for camera in job.config.camera]
    done = [table.id for table in job.survey.camera]
    left = ", ".join(name for name in names if name not in done) or f"none; close on {first}"
    while True:
        answer = job.ask(f"camera to occupy (left: {left}; Enter to end): ").strip()
        if answer in ("", *names):
            return answer
        print(f"{answer} is not configured; there are {', '.join(names)}")


def _occupy_tripod(job: SurveyJob, receiver: Receiver, antenna: AntennaTable, camera: str) -> Survey:
    """Both occupations of one tripod, compared, accepted by the operator and stored."""
    first = _one_occupation(job, receiver, antenna, f"{camera}, first")
    survey = edit.add_occupation(job.survey, camera, first)
    if not job.args.once:
        print("now break the corrections or cover the antenna until the fix is lost, then let it fix again")
        wait_for_lost_fix(receiver, _progress)
        second = _one_occupation(job, receiver, antenna, f"{camera}, second")
        survey = edit.add_occupation(survey, camera, second)
    print(edit.describe(survey))
    if not job.args.yes and not job.ask(f"accept {camera}? [y/N] ").strip().lower().startswith("y"):
        raise CalibrationError("rejected by the operator", where=f"camera {camera}", action="occupy it again")
    save_survey(survey, job.path)
    print(f"stored in {job.path}")
    return survey


def _one_occupation(job: SurveyJob, receiver: Receiver, antenna: AntennaTable, what: str) -> OccupationTable:
    print(f"{what} occupation: keep the antenna still")
    occupation = occupy(receiver, job.args.seconds, antenna, unix_ns=time.time_ns, progress=_progress)
    print()
    return occupation


def _progress(line: str) -> None:
    print(f"\r\x1b[K{line}", end="", flush=True)


def take_boxes(job: SurveyJob) -> int:
    """Workflow one: a receiver on each box, whose averages are taken over as they are."""
    survey = job.survey
    found: set[str] = set()
    with Link(job.config.link, name="survey") as link:
        inbox = link.watch_state(camera_key(job.config.site.name, "*", "fix"))
        until = time.monotonic() + job.args.seconds
        names = {camera.id for camera in job.config.camera}
        while found != names and (left_s := until - time.monotonic()) > 0:
            received = inbox.get(left_s)
            camera = camera_of_key(received.key) if received else None
            if received is None or camera not in names:
                continue
            fix = decode(received.payload, Fix, where=received.key)
            survey = edit.enter_fix(survey, camera, fix)
            found.add(camera)
            print(f"{camera}: {fix.samples} epochs, sigma {math.hypot(*fix.sigma_m[:2]) * 1000:.0f} mm horizontal")
    if not found:
        raise ConfigError(
            "no box has sent a position",
            where="survey boxes",
            action="see `edge-node check` on the boxes, wait, repeat",
        )
    for camera in sorted(names - found):
        print(f"{camera}: no position came", file=sys.stderr)
    return store(job, survey)


def _receiver_config(job: SurveyJob) -> GnssConfig:
    device = job.args.device or (job.config.receiver.device if job.config.receiver else None)
    if device is None:
        raise ConfigError("no receiver", where=str(job.args.config), action="give --device, or [receiver] device")
    return GnssConfig(
        device=device,
        baud=job.config.receiver.baud if job.config.receiver else 0,
        service=job.args.service,
        baseline_m=job.args.baseline,
    )


def _antenna(job: SurveyJob) -> AntennaTable:
    """The antenna as given, asked for where it was not: no height and no reference point is ever assumed."""
    args = job.args
    above_m = args.above_lens
    if above_m is None:
        answer = job.ask("antenna's height above the lens, metres: ")
        try:
            above_m = float(answer)
        except ValueError as error:
            raise ConfigError(f"{answer!r} is no number", where="--above-lens", action="give metres") from error
    measured_to = args.measured_to or job.ask("measured to its phase-centre or its ARP (underside)? ").strip()
    numbers = {
        "above_lens_m": above_m,
        "measured_to": measured_to,
        "position_of": args.position_of,
        "phase_centre_above_arp_m": args.phase_centre_above_arp,
        "beside_lens_m": args.beside_lens,
        "model": args.antenna,
        "measured_by": args.measured_by,
    }
    table = build({key: value for key, value in numbers.items() if value is not None}, AntennaTable, where="antenna")
    antenna_of(table)
    return table
