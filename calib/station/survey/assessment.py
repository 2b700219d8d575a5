"""What a survey is worth: loop closures, taped distances, a calibrated network beside it; and all of it in words."""

import datetime as dt
import math
from typing import Final

import numpy as np

from calib.errors import CalibrationError
from calib.geodesy import geodetic_to_enu
from calib.network import POSE_SIZE, Network
from calib.reference_frame import UNKNOWN_FRAME_SIGMA_M
from calib.solving.survey_check import NetworkCheck, TapeCheck, check_survey
from calib.station.core.site_extent import CORRECT_IT, too_far
from calib.station.survey.derive import absolute_sigmas, frame_of, occupations_of, taped
from calib.station.survey.store import CameraTable, ClosureTable, Survey
from calib.survey import Closure, apart, loop_closure
from edge.common.arrays import Array
from edge.common.units import NS
from edge.gnss.kept_fix import words

LEAST_CAMERAS: Final = 3  # fewer say nothing about the survey: their shape is free
TAPE_FAILED: Final = (
    "sigma covers it; enter the wrong position anew or tape it again, or say which are right with "
    "`base-station survey trust`"
)
LEAST_PRIOR_SIGMA_M: Final = 1e-3  # an entered sigma of zero would be an infinite weight


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
    return [check for _, check in taped(survey)]


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
    if not frame_of(survey).known:
        added = f"{UNKNOWN_FRAME_SIGMA_M:g} m is added to the absolute sigma"
        lines.append(f"WARNING: unknown frame: {added}; name it with `base-station survey frame --is`")
    lines += [line for table in survey.camera for line in _describe_camera(table)]
    if sigmas := absolute_sigmas(survey):
        worst = max(math.hypot(*sigma[:2]) for sigma in sigmas.values())
        where = site.frame if frame_of(survey).known else "WGS 84"
        lines.append(f"in {where}: {worst:.2f} m horizontally, the frame's uncertainty included")
    lines += [f"WARNING: {found}" for found in contradictions(survey)]
    if closure := closure_of(survey):
        lines.append(f"loop closure on {closure[0]} {closure[1]}")
    lines += [str(check) for check in tape_checks(survey) if check.passed]
    return "\n".join(lines)


def contradictions(survey: Survey) -> list[str]:
    """What speaks against a position of the survey, each with what is to be done about it."""
    far = too_far({table.id: table.position for table in survey.camera if table.position is not None})
    found = [f"{camera}: {why}; {CORRECT_IT}" for camera, why in far.items()]
    found += [_describe_failure(each) for each in survey.closure]
    return found + [f"{check}; {TAPE_FAILED}" for check in tape_checks(survey) if not check.passed]


def _describe_failure(closure: ClosureTable) -> str:
    """A round that did not close: by how much, whose fault it may be, and how it is settled."""
    when = dt.datetime.fromtimestamp(closure.t_unix_ns / NS, dt.UTC)
    return (
        f"not closed: back on {closure.camera} at {when:%Y-%m-%d %H:%M:%S} UTC it was {words(closure.off_m)} "
        f"where it was before: one or more of {', '.join(closure.cameras)} are false, sigma covers it; drop those "
        "and occupy them again, or say which are right with `base-station survey trust`"
    )


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
