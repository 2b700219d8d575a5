"""One call of `base-station survey`: what was asked for, and how what comes of it is shown, stored and read again.

The hazard is a survey that was stored and is not in force: in a file that the station does not read, or behind a
position that the configuration itself gives. So whoever stores says both.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import CalibrationError
from calib.geodesy import geodetic_to_enu
from calib.station.config import BaseConfig
from calib.station.survey import assessment
from calib.station.survey.in_force import survey_file
from calib.station.survey.store import CameraTable, Survey, save_survey
from edge.common.errors import ConfigError
from edge.gnss.kept_fix import contradict, words

Ask = Callable[[str], str]


@dataclass(frozen=True)
class SurveyCall:
    """The command's arguments, the station's configuration, the survey as it is and where it is kept."""

    args: argparse.Namespace
    config: BaseConfig
    survey: Survey
    path: Path
    ask: Ask = input


def configured(call: SurveyCall, camera: str) -> None:
    """Raises ConfigError if the station has no such camera."""
    names = [each.id for each in call.config.camera]
    if camera not in names:
        raise ConfigError(
            f"no camera {camera}", where=str(call.args.config), action=f"configured are: {', '.join(names)}"
        )


def replaced(call: SurveyCall, survey: Survey, camera: str) -> bool:
    """Whether `survey` may replace what is stored of a camera: asked where the two contradict each other."""
    old, new = call.survey.of(camera), survey.of(camera)
    if old is None or new is None or not (old.position and new.position and old.position_sigma and new.position_sigma):
        return True
    east, north, up = geodetic_to_enu(np.array([new.position]), old.position)[0].tolist()
    if call.args.yes or not contradict((east, north, up), new.position_sigma, old.position_sigma):
        return True
    question = f"{camera}: the new position is {words((east, north, up))} the stored one ({origin_of(old)})"
    return agreed(call, f"{question}; replace it?")


def agreed(call: SurveyCall, question: str) -> bool:
    """Whether the operator says yes to it; nobody there says no."""
    try:
        return call.ask(f"{question} [y/N] ").strip().lower().startswith("y")
    except EOFError:
        print()
        return False


def not_replaced(camera: str) -> CalibrationError:
    """What to say of a position that was not stored, because it contradicts the stored one."""
    return CalibrationError(
        "not stored: it contradicts the position that is stored",
        where=f"camera {camera}",
        action="see which of the two is right; `base-station survey drop` removes the stored one, --yes replaces it",
    )


def origin_of(table: CameraTable) -> str:
    """Where a stored position comes from."""
    return table.entered.source if table.entered else f"{len(table.occupation)} occupations"


def store(call: SurveyCall, survey: Survey) -> int:
    """Keep and show it, and say what keeps it from being in force. Returns the exit code."""
    keep(call, survey)
    print(assessment.describe(survey))
    for line in remarks(call, survey):
        print(line)
    return 0


def keep(call: SurveyCall, survey: Survey) -> None:
    """Write it, and say where."""
    save_survey(survey, call.path)
    print(f"stored in {call.path}")


def remarks(call: SurveyCall, survey: Survey) -> Iterator[str]:
    """What an operator must still do before the station uses the survey."""
    base = Path(call.args.config)
    used = survey_file(call.config, base.parent)
    if used is None or used.resolve() != call.path.resolve():
        yield f'the station does not read it: write survey = "{call.path.resolve()}" under [site] in {base}'
    for camera in call.config.camera:
        if camera.position is not None and survey.of(camera.id) is not None:
            yield f"{camera.id}: not used, {base} gives a position itself: take `position` out there"
    yield "a running station reads it at its next start"
