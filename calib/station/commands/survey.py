"""`base-station survey`: from a rover and a serial cable, from the boxes' own receivers, or from a list, to positions.

Three ways lead to the same file, and what changes it is always the same: a pure edit, shown, then stored whole. Without
an action the survey is shown.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from msgspec.structs import asdict, replace

from calib.network import from_toml
from calib.station.config import load
from calib.station.survey import assessment, edit
from calib.station.survey.arguments import add_arguments
from calib.station.survey.box_fixes import take_boxes
from calib.station.survey.call import Ask, SurveyCall, configured, not_replaced, replaced, store
from calib.station.survey.derive import derived
from calib.station.survey.in_force import SURVEY_FILE
from calib.station.survey.rover_round import occupy_one, rover_round
from calib.station.survey.store import Survey, SurveySite, TapeTable, load_survey
from edge.common.errors import ConfigError
from edge.common.settings import build

__all__ = ["add_arguments", "run"]


def run(args: argparse.Namespace, ask: Ask = input) -> int:
    """Do what the arguments say. Returns the exit code; raises SkyfixError with the reason otherwise."""
    config = load(args.config)
    path = args.file or Path(args.config).parent / (config.site.survey or SURVEY_FILE)
    survey = load_survey(path) if path.exists() else Survey(site=SurveySite(name=config.site.name))
    return ACTIONS[args.action or "show"](SurveyCall(args, config, survey, path, ask))


def _show(call: SurveyCall) -> int:
    print(assessment.describe(call.survey))
    return 0


def _enter(call: SurveyCall) -> int:
    configured(call, call.args.camera)
    args = call.args
    east, north, up = args.sigma
    place = (args.latitude, args.longitude, args.height)
    survey = edit.enter(call.survey, args.camera, place, (east, north, up), args.source)
    if not replaced(call, survey, args.camera):
        raise not_replaced(args.camera)
    return store(call, survey)


def _import(call: SurveyCall) -> int:
    try:
        text = call.args.csv.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot be read ({error})", where=str(call.args.csv), action="give a CSV file") from error
    survey = edit.enter_csv(call.survey, text, str(call.args.csv))
    for table in survey.camera:
        if not replaced(call, survey, table.id):
            raise not_replaced(table.id)
    return store(call, survey)


def _trust(call: SurveyCall) -> int:
    return store(call, edit.trust(call.survey, call.args.camera))


def _drop(call: SurveyCall) -> int:
    if call.args.occupation is None:
        return store(call, edit.drop_camera(call.survey, call.args.camera))
    return store(call, edit.drop_occupation(call.survey, call.args.camera, call.args.occupation))


def _tape(call: SurveyCall) -> int:
    args = call.args
    numbers = {"first": args.first, "second": args.second, "distance_m": args.metres, "sigma_m": args.sigma}
    return store(call, edit.add_tape(call.survey, build(numbers, TapeTable, where="survey tape")))


def _frame(call: SurveyCall) -> int:
    args = call.args
    given = {
        "raw_frame": args.raw_frame,
        "epoch": args.epoch,
        "service": args.from_service,
        "base": args.from_base,
        "convert_to": args.convert_to,
        "shift_enu_m": tuple(args.shift) if args.shift else None,
        "shift_note": args.shift_note,
    }
    changed: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    if changed.get("convert_to") == "none":
        changed["convert_to"] = None
    site = build({**asdict(call.survey.site), **changed}, SurveySite, where="survey frame")
    return store(call, derived(replace(call.survey, site=site)))


def _check(call: SurveyCall) -> int:
    try:
        text = call.args.network.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"cannot be read ({error})", where=str(call.args.network), action="give the network.toml of a calibration"
        ) from error
    verdict = assessment.check_network(call.survey, from_toml(text, where=str(call.args.network)))
    tapes = assessment.tape_checks(call.survey)
    print("\n".join([str(verdict), *(str(tape) for tape in tapes)]))
    return 0 if verdict.passed and all(tape.passed for tape in tapes) else 1


ACTIONS: Final[dict[str, Callable[[SurveyCall], int]]] = {
    "show": _show,
    "occupy": occupy_one,
    "rover": rover_round,
    "boxes": take_boxes,
    "enter": _enter,
    "import": _import,
    "drop": _drop,
    "trust": _trust,
    "tape": _tape,
    "frame": _frame,
    "check": _check,
}
