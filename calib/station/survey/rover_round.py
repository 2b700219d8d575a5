"""The survey by a rover: from tripod to tripod, each occupied twice, and back to the first.

The hazard is a wrong position that is stored unnoticed. So nothing is written before it has been compared with what is
there already, the operator sees the comparison before accepting, and what was rejected is said with its reason.
"""

import sys
import time
from dataclasses import replace

from calib.errors import CalibrationError
from calib.station.inputs.input import PositionInput
from calib.station.inputs.receiver import opened_receiver, receiver_settings
from calib.station.survey import assessment, edit
from calib.station.survey.call import SurveyCall, configured, keep, not_replaced, remarks, replaced
from calib.station.survey.derive import antenna_of
from calib.station.survey.rover import occupy, wait_for_lost_fix
from calib.station.survey.store import AntennaTable, OccupationTable, Survey
from edge.common.errors import ConfigError
from edge.common.settings import build
from edge.config import GnssConfig
from edge.gnss.kept_fix import words


def occupy_one(call: SurveyCall) -> int:
    """One tripod. Returns the exit code; raises CalibrationError if it is not accepted."""
    configured(call, call.args.camera)
    antenna = _antenna(call)
    with opened_receiver(_receiver_settings(call), call.config.site.undulation_m) as receiver:
        survey = _occupy_tripod(call, receiver, antenna, call.args.camera)
    print("\n".join(remarks(call, survey)))
    return 0


def rover_round(call: SurveyCall) -> int:
    """The whole round: every camera in the order of the operator's choice, and back to the first."""
    antenna = _antenna(call)
    first: str | None = None
    with opened_receiver(_receiver_settings(call), call.config.site.undulation_m) as receiver:
        while camera := _choose(call, first):
            try:
                call = replace(call, survey=_occupy_tripod(call, receiver, antenna, camera))
            except _NotClosedError as error:
                print(f"not stored: {error}", file=sys.stderr)
                call = replace(call, survey=error.survey)
                continue
            except CalibrationError as error:
                print(f"not stored: {error}", file=sys.stderr)
                continue
            first = first or camera
    print("\n".join(remarks(call, call.survey)))
    closure = assessment.closure_of(call.survey)
    print(f"loop closure on {closure[0]} {closure[1]}" if closure else "the round was not closed on its first tripod")
    return 0 if closure and not closure[1].apart.too_far else 1


class _NotClosedError(CalibrationError):
    """An occupation that contradicts an earlier one of its tripod. survey: with that kept in it."""

    def __init__(self, survey: Survey, camera: str) -> None:
        closure = survey.closure[-1]
        super().__init__(
            f"it is {words(closure.off_m)} where it was before: one of {', '.join(closure.cameras)} is false, "
            "or the base or the tripod moved",
            where=f"camera {camera}",
            action="see `base-station survey show`; drop what is false and occupy it again",
        )
        self.survey = survey


def _choose(call: SurveyCall, first: str | None) -> str:
    """The next tripod's camera; empty when the operator is done."""
    names = [camera.id for camera in call.config.camera]
    done = [table.id for table in call.survey.camera]
    left = ", ".join(name for name in names if name not in done) or f"none; close on {first}"
    while True:
        answer = call.ask(f"camera to occupy (left: {left}; Enter to end): ").strip()
        if answer in ("", *names):
            return answer
        print(f"{answer} is not configured; there are {', '.join(names)}")


def _occupy_tripod(call: SurveyCall, receiver: PositionInput, antenna: AntennaTable, camera: str) -> Survey:
    """Both occupations of one tripod, compared, accepted by the operator and stored."""
    first = _one_occupation(call, receiver, antenna, f"{camera}, first")
    if failed := edit.closure_failed(call.survey, camera, first):
        keep(call, failed)
        raise _NotClosedError(failed, camera)
    survey = edit.add_occupation(call.survey, camera, first)
    if not call.args.once:
        print("now break the corrections or cover the antenna until the fix is lost, then let it fix again")
        wait_for_lost_fix(receiver, _progress)
        second = _one_occupation(call, receiver, antenna, f"{camera}, second")
        survey = edit.add_occupation(survey, camera, second)
    print(assessment.describe(survey))
    if not replaced(call, survey, camera):
        raise not_replaced(camera)
    if not call.args.yes and not call.ask(f"accept {camera}? [y/N] ").strip().lower().startswith("y"):
        raise CalibrationError("rejected by the operator", where=f"camera {camera}", action="occupy it again")
    keep(call, survey)
    return survey


def _one_occupation(call: SurveyCall, receiver: PositionInput, antenna: AntennaTable, what: str) -> OccupationTable:
    print(f"{what} occupation: keep the antenna still")
    occupation = occupy(receiver, call.args.seconds, antenna, unix_ns=time.time_ns, progress=_progress)
    print()
    return occupation


def _progress(line: str) -> None:
    print(f"\r\x1b[K{line}", end="", flush=True)


def _receiver_settings(call: SurveyCall) -> GnssConfig:
    args = call.args
    return receiver_settings(
        call.config.receiver,
        where=str(args.config),
        device=args.device,
        service=args.service,
        baseline_m=args.baseline,
        separation_m=args.separation,
        accept_unknown_age=args.accept_unknown_age,
    )


def _antenna(call: SurveyCall) -> AntennaTable:
    """The antenna as given, asked for where it was not: no height and no reference point is ever assumed."""
    args = call.args
    above_m = args.above_lens
    if above_m is None:
        answer = call.ask("antenna's height above the lens, metres: ")
        try:
            above_m = float(answer)
        except ValueError as error:
            raise ConfigError(f"{answer!r} is no number", where="--above-lens", action="give metres") from error
    measured_to = args.measured_to or call.ask("measured to its phase-centre or its ARP (underside)? ").strip()
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
