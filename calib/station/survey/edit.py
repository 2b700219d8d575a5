"""What an operator does to a survey, each as a pure function: old survey in, new survey out, or the reason why not."""

import csv
import io
from typing import Final

import numpy as np
from msgspec.structs import replace

from calib.geodesy import geodetic_to_enu
from calib.reference_frame import ReferenceFrame
from calib.station.core.positions import lens_position
from calib.station.survey.derive import derived, occupations_of, taped
from calib.station.survey.store import CameraTable, ClosureTable, EnteredTable, OccupationTable, Survey, TapeTable
from calib.survey import apart
from edge.common.errors import ConfigError
from edge.common.settings import build
from edge.messages import Fix

CSV_COLUMNS: Final = ("id", "lat_deg", "lon_deg", "height_m", "sigma_east_m", "sigma_north_m", "sigma_up_m")


def add_occupation(survey: Survey, camera: str, occupation: OccupationTable) -> Survey:
    """With one more occupation of a tripod. Raises CalibrationError if it contradicts the earlier ones."""
    table = survey.of(camera) or CameraTable(id=camera)
    occupied = replace(table, entered=None, occupation=(*table.occupation, occupation))
    return derived(survey.with_camera(occupied))


def closure_failed(survey: Survey, camera: str, occupation: OccupationTable) -> Survey | None:
    """With what a round missed by that came back to a tripod, kept with the points it may be the fault of.

    None if the occupation contradicts none of the tripod's earlier ones.
    """
    table = survey.of(camera) or CameraTable(id=camera)
    earlier, now = occupations_of(table), occupations_of(CameraTable(id=camera, occupation=(occupation,)))[0]
    first = next((each for each in earlier if apart(each, now).too_far), None)
    if first is None:
        return None
    east, north, up = geodetic_to_enu(np.array([now.lens_geodetic]), first.lens_geodetic)[0].tolist()
    since = tuple(
        other.id for other in survey.camera if any(each.t_unix_ns >= first.t_unix_ns for each in other.occupation)
    )
    closure = ClosureTable(
        camera=camera, t_unix_ns=occupation.t_unix_ns, off_m=(round(east, 4), round(north, 4), round(up, 4)),
        cameras=since,
    )  # fmt: skip
    return derived(replace(survey, closure=(*survey.closure, closure)))


def trust(survey: Survey, camera: str) -> Survey:
    """With a point that the operator knows to be right: what contradicts it is not its fault.

    A tape between two points that are right was misread, and goes.
    """
    _known(survey, camera)
    failing = [tape for tape, check in taped(survey) if not check.passed and camera in (tape.first, tape.second)]
    tapes = (replace(tape, trusted=(*tape.trusted, camera)) if tape in failing else tape for tape in survey.tape)
    left = tuple(tape for tape in tapes if not {tape.first, tape.second} <= set(tape.trusted))
    return derived(_acquitted(replace(survey, tape=left), camera))


def _acquitted(survey: Survey, camera: str) -> Survey:
    """The survey with a tripod out of every closure's suspects; a closure without suspects is over."""
    left = [replace(each, cameras=tuple(name for name in each.cameras if name != camera)) for each in survey.closure]
    return replace(survey, closure=tuple(each for each in left if each.cameras))


def drop_camera(survey: Survey, camera: str) -> Survey:
    """Without a tripod and the tapes that end there. Raises ConfigError if it is not there."""
    _known(survey, camera)
    left = tuple(table for table in survey.camera if table.id != camera)
    tapes = tuple(tape for tape in survey.tape if camera not in (tape.first, tape.second))
    return derived(_acquitted(replace(survey, camera=left, tape=tapes), camera))


def drop_occupation(survey: Survey, camera: str, number: int) -> Survey:
    """Without one occupation (1 is the first): the odd one out. Raises ConfigError if there is none of that number."""
    table = _known(survey, camera)
    if not 1 <= number <= len(table.occupation):
        raise ConfigError(
            f"{camera} has {len(table.occupation)} occupations, no number {number}",
            where="survey drop",
            action="see `survey show`",
        )
    left = tuple(each for i, each in enumerate(table.occupation, start=1) if i != number)
    if not left:
        return drop_camera(survey, camera)
    return derived(_acquitted(survey.with_camera(replace(table, occupation=left)), camera))


def enter(
    survey: Survey,
    camera: str,
    position: tuple[float, float, float],
    sigma: tuple[float, float, float],
    source: str,
) -> Survey:
    """With a lens position from elsewhere in place of what was there. Raises ConfigError for numbers out of range."""
    entered = {"position": list(position), "sigma": list(sigma), "source": source}
    table = build({"id": camera, "entered": entered}, CameraTable, where=f"camera {camera}")
    return derived(_acquitted(survey.with_camera(table), camera))


def enter_csv(survey: Survey, text: str, source: str) -> Survey:
    """With every row of a CSV file entered. Raises ConfigError naming the row."""
    rows = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    missing = [column for column in CSV_COLUMNS if column not in (rows.fieldnames or ())]
    if missing:
        raise ConfigError(
            f"column {missing[0]} is missing", where=source, action=f"begin with the line {','.join(CSV_COLUMNS)}"
        )
    for row in rows:
        where = f"{source}, line {rows.line_num}"
        try:
            lat, lon, height, east, north, up = (float(row[column]) for column in CSV_COLUMNS[1:])
        except (TypeError, ValueError) as error:
            raise ConfigError(f"not a number ({error})", where=where, action="correct the row") from error
        survey = enter(survey, row["id"], (lat, lon, height), (east, north, up), where)
    return survey


def enter_fix(survey: Survey, camera: str, fix: Fix) -> Survey:
    """With the lens position by a box's own receiver. Raises ConfigError if its frame is another than the file's."""
    site = survey.site
    if ReferenceFrame(site.raw_frame).known and site.raw_frame != fix.frame:
        raise ConfigError(
            f"its fix is in {fix.frame}, the survey in {site.raw_frame}",
            where=f"camera {camera}",
            action="set the same frame on every box, or begin another survey file",
        )
    labelled = replace(survey, site=replace(site, raw_frame=fix.frame))
    position, sigma_m = lens_position(fix)
    point = "" if fix.of == "lens" else ", of its antenna"
    source = f"the box's receiver{point}, {fix.samples} epochs"
    entered = EnteredTable(position=position, sigma=sigma_m, source=source)
    return derived(_acquitted(labelled.with_camera(CameraTable(id=camera, entered=entered)), camera))


def add_tape(survey: Survey, tape: TapeTable) -> Survey:
    """With a taped distance, in place of one taped before between the two.

    Raises ConfigError if one of its ends is not surveyed, or both are the same.
    """
    _known(survey, tape.first)
    _known(survey, tape.second)
    if tape.first == tape.second:
        raise ConfigError(f"from {tape.first} to itself", where="survey tape", action="name two lenses")
    ends = {tape.first, tape.second}
    others = tuple(old for old in survey.tape if {old.first, old.second} != ends)
    return derived(replace(survey, tape=(*others, tape)))


def _known(survey: Survey, camera: str) -> CameraTable:
    table = survey.of(camera)
    if table is None:
        names = ", ".join(each.id for each in survey.camera) or "none"
        raise ConfigError(f"{camera} is not surveyed", where="survey", action=f"surveyed are: {names}")
    return table
