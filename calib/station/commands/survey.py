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
from calib.station.survey import edit
from calib.station.survey.arguments import DEFAULT_FILE, add_arguments
from calib.station.survey.field import Ask, SurveyJob, configured, occupy_one, rover_round, store, take_boxes
from calib.station.survey.store import Survey, SurveySite, TapeTable, derived, load_survey
from edge.common.errors import ConfigError
from edge.common.settings import build

__all__ = ["add_arguments", "run"]


def run(args: argparse.Namespace, ask: Ask = input) -> int:
    """Do what the arguments say. Returns the exit code; raises SkyfixError with the reason otherwise."""
    config = load(args.config)
    path = args.file or Path(args.config).parent / (config.site.survey or DEFAULT_FILE)
    survey = load_survey(path) if path.exists() else Survey(site=SurveySite(name=config.site.name))
    return ACTIONS[args.action or "show"](SurveyJob(args, config, survey, path, ask))


def _show(job: SurveyJob) -> int:
    print(edit.describe(job.survey))
    return 0


def _enter(job: SurveyJob) -> int:
    configured(job, job.args.camera)
    lat, lon, height = job.args.position
    east, north, up = job.args.sigma
    return store(job, edit.enter(job.survey, job.args.camera, (lat, lon, height), (east, north, up), job.args.source))


def _import(job: SurveyJob) -> int:
    try:
        text = job.args.csv.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot be read ({error})", where=str(job.args.csv), action="give a CSV file") from error
    return store(job, edit.enter_csv(job.survey, text, str(job.args.csv)))


def _drop(job: SurveyJob) -> int:
    if job.args.occupation is None:
        return store(job, edit.drop_camera(job.survey, job.args.camera))
    return store(job, edit.drop_occupation(job.survey, job.args.camera, job.args.occupation))


def _tape(job: SurveyJob) -> int:
    args = job.args
    numbers = {"first": args.first, "second": args.second, "distance_m": args.metres, "sigma_m": args.sigma}
    return store(job, edit.add_tape(job.survey, build(numbers, TapeTable, where="survey tape")))


def _frame(job: SurveyJob) -> int:
    args = job.args
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
    site = build({**asdict(job.survey.site), **changed}, SurveySite, where="survey frame")
    return store(job, derived(replace(job.survey, site=site)))


def _check(job: SurveyJob) -> int:
    try:
        text = job.args.network.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"cannot be read ({error})", where=str(job.args.network), action="give the network.toml of a calibration"
        ) from error
    verdict = edit.check_network(job.survey, from_toml(text, where=str(job.args.network)))
    tapes = edit.tape_checks(job.survey)
    print("\n".join([str(verdict), *(str(tape) for tape in tapes)]))
    return 0 if verdict.passed and all(tape.passed for tape in tapes) else 1


ACTIONS: Final[dict[str, Callable[[SurveyJob], int]]] = {
    "show": _show,
    "occupy": occupy_one,
    "rover": rover_round,
    "boxes": take_boxes,
    "enter": _enter,
    "import": _import,
    "drop": _drop,
    "tape": _tape,
    "frame": _frame,
    "check": _check,
}
