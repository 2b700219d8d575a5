"""The positions that follow from a survey's raw coordinates: combined, converted, shifted.

The hazard is a derived number that outlives what it was derived from. So nothing here is kept: every change of the file
computes all of it anew.
"""

import math

import numpy as np
from msgspec.structs import asdict, replace

from calib.geodesy import Origin, enu_to_geodetic, geodetic_to_enu
from calib.reference_frame import ReferenceFrame
from calib.solving.survey_check import TapeCheck, check_tape
from calib.station.survey.frames import convert
from calib.station.survey.store import LARGEST_SIGMA_M, AntennaTable, CameraTable, Survey, SurveySite, TapeTable
from calib.survey import Antenna, Occupation, SurveyedPoint, combine
from edge.common.arrays import Array
from edge.common.errors import ConfigError


def derived(survey: Survey) -> Survey:
    """The survey with every position computed anew from its raw coordinates: combined, converted, shifted.

    Raises CalibrationError if two occupations of a tripod differ too much, ConfigError if the frame cannot be had.
    """
    points = {table.id: point for table in survey.camera if (point := _raw_point(table)) is not None}
    raw = np.array([point.geodetic for point in points.values()]).reshape(-1, 3)
    site, geodetic = _in_frame(survey.site, raw)
    positions = dict(zip(points, _shifted(geodetic, site.shift_enu_m).tolist(), strict=True))
    tables = []
    for table in survey.camera:
        point = points.get(table.id)
        position = _rounded(positions[table.id]) if point else None
        sigma_m = _closed(survey, table.id, point.sigma_m) if point else None
        tables.append(replace(table, position=position, position_sigma=sigma_m))
    return _taped(replace(survey, site=site, camera=tuple(tables)))


def taped(survey: Survey) -> list[tuple[TapeTable, TapeCheck]]:
    """Every taped distance between two positions, against the surveyed one by what the survey alone claims."""
    checks = []
    for tape in survey.tape:
        ends = [table for name in (tape.first, tape.second) if (table := survey.of(name)) is not None]
        points = [point for table in ends if (point := _raw_point(table)) is not None]
        positions = [table.position for table in ends if table.position]
        if len(positions) == 2 and len(points) == 2:
            enu = geodetic_to_enu(np.array(positions), positions[0])
            sigmas_m = np.array([point.sigma_m for point in points])
            checks.append(
                (tape, check_tape((tape.first, tape.second), enu, sigmas_m, tape.distance_m, tape_sigma_m=tape.sigma_m))
            )
    return checks


def _taped(survey: Survey) -> Survey:
    """With sigmas that cover what taped distances contradict of them, in whichever direction that may be."""
    for tape, check in taped(survey):
        for name in {tape.first, tape.second} - set(tape.trusted) if not check.passed else ():
            table = survey.of(name)
            if table is not None and table.position_sigma is not None:
                east, north, up = (
                    min(math.hypot(s, check.difference_m), LARGEST_SIGMA_M) for s in table.position_sigma
                )
                survey = survey.with_camera(replace(table, position_sigma=(east, north, up)))
    return survey


def _closed(survey: Survey, camera: str, sigma_m: tuple[float, float, float]) -> tuple[float, float, float]:
    """A point's sigma: with what rounds miss by in which it may be the false one."""
    for closure in survey.closure:
        if camera in closure.cameras:
            east, north, up = (math.hypot(sigma, off) for sigma, off in zip(sigma_m, closure.off_m, strict=True))
            sigma_m = (east, north, up)
    return sigma_m


def frame_of(survey: Survey) -> ReferenceFrame:
    """The frame of its positions."""
    return ReferenceFrame(survey.site.frame, survey.site.frame_sigma_m)


def absolute_sigmas(survey: Survey) -> dict[str, tuple[float, float, float]]:
    """One sigma in WGS 84 of each surveyed lens: with what is not known about the frame."""
    return {
        table.id: _absolute(table.position_sigma, frame_of(survey).sigma_m)
        for table in survey.camera
        if table.position_sigma is not None
    }


def _absolute(sigma_m: tuple[float, float, float], shared_m: float) -> tuple[float, float, float]:
    east, north, up = (math.hypot(sigma, shared_m) for sigma in sigma_m)
    return east, north, up


def occupations_of(table: CameraTable) -> list[Occupation]:
    """The tripod's occupations as the mathematics wants them. Raises CalibrationError as Antenna does."""
    return [
        Occupation(
            t_unix_ns=each.t_unix_ns,
            duration_s=each.duration_s,
            samples=each.samples,
            geodetic=each.position,
            scatter_m=each.scatter_m,
            floor_m=each.floor_m,
            fixed_m=each.fixed_m,
            antenna=antenna_of(each.antenna),
        )
        for each in table.occupation
    ]


def antenna_of(table: AntennaTable) -> Antenna:
    """The antenna as the mathematics wants it. Raises CalibrationError if it cannot be allowed for."""
    return Antenna(**asdict(table))


def _raw_point(table: CameraTable) -> SurveyedPoint | None:
    if table.occupation:
        return combine(occupations_of(table), where=f"camera {table.id}")
    if table.entered:
        return SurveyedPoint(table.entered.position, table.entered.sigma, 1)
    return None


def _rounded(position: list[float]) -> Origin:
    """To a micrometre: what a person reading the file can compare."""
    latitude, longitude, height = position
    return round(latitude, 11), round(longitude, 11), round(height, 6)


def _in_frame(site: SurveySite, raw: Array) -> tuple[SurveySite, Array]:
    """The site and (N, 3) positions in the frame that was asked for, or as they came with their label."""
    if site.convert_to is None or len(raw) == 0:
        return replace(site, frame=site.raw_frame, frame_note="passed through", frame_sigma_m=0.0), raw
    if site.epoch is None:
        raise ConfigError("the coordinates' epoch is not known", where="site.epoch", action="give the decimal year")
    converted = convert(raw, site.raw_frame, site.convert_to, site.epoch)
    known = replace(site, frame=site.convert_to, frame_note=converted.note, frame_sigma_m=converted.accuracy_m)
    return known, converted.geodetic


def _shifted(geodetic: Array, shift_enu_m: tuple[float, float, float]) -> Array:
    """(N, 3) positions moved by the operator's vector, each in its own east, north, up."""
    if not any(shift_enu_m) or len(geodetic) == 0:
        return geodetic
    shift = np.array([shift_enu_m])
    return np.concatenate([enu_to_geodetic(shift, (row[0], row[1], row[2])) for row in geodetic.tolist()])
