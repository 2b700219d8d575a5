"""What an operator does to a survey, each as a pure function: old survey in, new survey out, or the reason why not."""

import csv
import io
import math
from typing import Final

import numpy as np
from msgspec.structs import replace

from calib.errors import CalibrationError
from calib.geodesy import geodetic_to_enu
from calib.network import POSE_SIZE, Network
from calib.solving.survey_check import NetworkCheck, TapeCheck, check_survey, check_tape
from calib.station.core.positions import lens_position
from calib.station.survey.frames import frame_known
from calib.station.survey.store import (
    CameraTable,
    EnteredTable,
    OccupationTable,
    Survey,
    TapeTable,
    absolute_sigmas,
    derived,
    occupations_of,
)
from calib.survey import Closure, apart, loop_closure
from edge.common.arrays import Array
from edge.common.errors import ConfigError
from edge.common.settings import build
from edge.messages import Fix

LEAST_CAMERAS: Final = 3  # fewer say nothing about the survey: their shape is free
LEAST_PRIOR_SIGMA_M: Final = 1e-3  # an entered sigma of zero would be an infinite weight
CSV_COLUMNS: Final = ("id", "lat_deg", "lon_deg", "height_m", "sigma_east_m", "sigma_north_m", "sigma_up_m")


def add_occupation(survey: Survey, camera: str, occupation: OccupationTable) -> Survey:
    """With one more occupation of a tripod. Raises CalibrationError if it contradicts the earlier ones."""
    table = survey.of(camera) or CameraTable(id=camera)
    occupied = replace(table, entered=None, occupation=(*table.occupation, occupation))
    return derived(survey.with_camera(occupied))


def drop_camera(survey: Survey, camera: str) -> Survey:
    """Without a tripod and the tapes that end there. Raises ConfigError if it is not there."""
    _known(survey, camera)
    left = tuple(table for table in survey.camera if table.id != camera)
    tapes = tuple(tape for tape in survey.tape if camera not in (tape.first, tape.second))
    return derived(replace(survey, camera=left, tape=tapes))


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
    return derived(survey.with_camera(replace(table, occupation=left)))


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
    return derived(survey.with_camera(table))


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
    if frame_known(site.raw_frame) and site.raw_frame != fix.frame:
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
    return derived(labelled.with_camera(CameraTable(id=camera, entered=entered)))


def add_tape(survey: Survey, tape: TapeTable) -> Survey:
    """With a taped distance. Raises ConfigError if one of its ends is not surveyed."""
    _known(survey, tape.first)
    _known(survey, tape.second)
    return replace(survey, tape=(*survey.tape, tape))


def closure_of(survey: Survey) -> tuple[str, Closure] | None:
    """The tripod occupied first, and how well the rover's last occupation of it closes; None before it is back."""
    occupied = [table for table in survey.camera if table.occupation]
    if not occupied:
        return None
    first = min(occupied, key=lambda table: min(each.t_unix_ns for each in table.occupation))
    newest = max((each.t_unix_ns, table.id) for table in occupied for each in table.occupation)
    closure = loop_closure(occupations_of(first))
    return (first.id, closure) if closure and newest[1] == first.id and len(occupied) > 1 else None


def tape_checks(survey: Survey) -> list[TapeCheck]:
    """Every taped distance against the surveyed one."""
    checks = []
    for tape in survey.tape:
        ends = [survey.of(tape.first), survey.of(tape.second)]
        positions = [end.position for end in ends if end and end.position]
        sigmas = [end.position_sigma for end in ends if end and end.position_sigma]
        if len(positions) == 2 and len(sigmas) == 2:
            enu = geodetic_to_enu(np.array(positions), positions[0])
            names = (tape.first, tape.second)
            checks.append(check_tape(names, enu, np.array(sigmas), tape.distance_m, tape_sigma_m=tape.sigma_m))
    return checks


def check_network(survey: Survey, network: Network) -> NetworkCheck:
    """The survey against a network that was calibrated with it. Raises CalibrationError below three common cameras."""
    names = [c.id for c in network.cameras if (table := survey.of(c.id)) is not None and table.position is not None]
    if len(names) < LEAST_CAMERAS:
        raise CalibrationError(
            f"{len(names)} cameras are both surveyed and calibrated",
            where="survey check",
            action="survey three or more",
        )
    tables = [survey.of(name) for name in names]
    surveyed = geodetic_to_enu(np.array([table.position for table in tables if table]), network.origin)
    sigmas = np.array([table.position_sigma for table in tables if table], float).reshape(-1)
    adjusted = np.array([camera.centre_enu for camera in network.cameras if camera.id in names])
    prior = np.diag(np.maximum(sigmas, LEAST_PRIOR_SIGMA_M) ** 2)
    return check_survey(names, surveyed, prior, adjusted, centre_covariance(network, names))


def centre_covariance(network: Network, names: list[str]) -> Array:
    """(3 n, 3 n) joint covariance of the named cameras' centres, in the network's order."""
    at = [
        POSE_SIZE * i + 3 + axis for i, camera in enumerate(network.cameras) if camera.id in names for axis in range(3)
    ]
    return network.covariance[np.ix_(at, at)]


def describe(survey: Survey) -> str:
    """What `survey show` prints: every tripod, how it is known and how well, closures and tapes."""
    site = survey.site
    lines = [f"site {site.name}: frame {site.frame} ({site.frame_note}), epoch {site.epoch or 'unknown'}"]
    lines.append(f"corrections: {site.service or 'unknown'}; base: {site.base or 'unknown'}")
    if not frame_known(site.frame):
        lines.append("WARNING: unknown frame: 1 m is added to the absolute sigma; name it with `survey frame`")
    lines += [line for table in survey.camera for line in _describe_camera(table)]
    if sigmas := absolute_sigmas(survey):
        worst = max(math.hypot(*sigma[:2]) for sigma in sigmas.values())
        lines.append(f"in WGS 84: {worst:.2f} m horizontally, the frame's uncertainty included")
    if closure := closure_of(survey):
        lines.append(f"loop closure on {closure[0]} {closure[1]}")
    lines += [str(check) for check in tape_checks(survey)]
    return "\n".join(lines)


def _describe_camera(table: CameraTable) -> list[str]:
    if table.position is None or table.position_sigma is None:
        return [f"{table.id}: no position"]
    lat, lon, height = table.position
    east, north, up = (sigma * 1000 for sigma in table.position_sigma)
    source = table.entered.source if table.entered else f"{len(table.occupation)} occupations"
    place = f"{lat:.9f} {lon:.9f} {height:.4f} m"
    lines = [f"{table.id}: {place}, sigma {east:.0f} {north:.0f} {up:.0f} mm ({source})"]
    occupations = occupations_of(table)
    lines += [
        f"  occupation {i}: {apart(occupations[0], each)} from the first"
        for i, each in enumerate(occupations[1:], start=2)
    ]
    return lines


def _known(survey: Survey, camera: str) -> CameraTable:
    table = survey.of(camera)
    if table is None:
        names = ", ".join(each.id for each in survey.camera) or "none"
        raise ConfigError(f"{camera} is not surveyed", where="survey", action=f"surveyed are: {names}")
    return table
