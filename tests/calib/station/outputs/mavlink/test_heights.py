"""One antenna height, from the receiver's sentences to MAVLink: taken off once, whichever way the position comes."""

import datetime as dt
import time
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from calib.geodesy import enu_to_geodetic
from calib.station.config import CameraSection, MavlinkSection
from calib.station.core.intake import CameraIntake
from calib.station.core.outgoing import TargetExport
from calib.station.core.positions import Positions
from calib.station.outputs.mavlink import messages
from calib.station.outputs.mavlink.identity import identity_of
from calib.station.outputs.mavlink.messages import MavlinkContext
from calib.station.survey import edit
from calib.station.survey.store import Survey, SurveySite
from calib.tracking.estimates import TargetEstimate, TargetState
from edge.config import GnssConfig
from edge.gnss.receiver import make_fix
from edge.gnss.session import StaticSession
from edge.messages import Fix
from tools.doubles.receiver import Place, gga

LENS = Place()
UNDULATION_M = LENS.separation_m
ABOVE_M = 50.0  # of the target over the lens
NAMES = ("cam0", "cam1", "cam2")


def box_fix(lever_arm_m: tuple[float, float, float]) -> Fix:
    """What a box says whose antenna stands so over the lens at LENS."""
    session, start = StaticSession(), dt.datetime(2026, 6, 1, 12, tzinfo=dt.UTC)
    for second in range(60):
        session.feed(gga(start + dt.timedelta(seconds=second), LENS, np.array(lever_arm_m)), float(second))
    surveyed = session.surveyed()
    assert surveyed is not None
    return make_fix(surveyed, GnssConfig(device="/dev/null", lever_arm_m=lever_arm_m), time.time_ns())


def by_the_boxes(fix: Fix) -> Positions:
    """The station uses what the boxes say."""
    boxes = {name: CameraIntake(name) for name in NAMES}
    for box in boxes.values():
        box.stand_by(fix)
    positions = Positions({name: CameraSection(id=name) for name in NAMES}, None)
    positions.update(boxes)
    return positions


def by_the_survey(fix: Fix) -> Positions:
    """`base-station survey boxes` has stored them."""
    survey = Survey(site=SurveySite(name="hill"))
    for name in NAMES:
        survey = edit.enter_fix(survey, name, fix)
    sections = {
        table.id: CameraSection(id=table.id, position=table.position, position_sigma=table.position_sigma or (1, 1, 1))
        for table in survey.camera
    }
    positions = Positions(sections, None)
    positions.update({name: CameraIntake(name) for name in NAMES})
    return positions


@pytest.mark.parametrize("lever_arm_m", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.165), (0.0, 0.0, 1.5), (0.005, -0.005, -0.3)])
@pytest.mark.parametrize("way", [by_the_boxes, by_the_survey])
def test_what_is_sent_stands_where_it_flies(
    lever_arm_m: tuple[float, float, float], way: type[Positions] | object
) -> None:
    positions = way(box_fix(lever_arm_m))  # type: ignore[operator]
    assert positions.origin is not None
    lens = positions.of("cam0", CameraIntake("cam0", fix=box_fix(lever_arm_m)))
    assert lens is not None
    estimate = TargetEstimate(
        track=1, state=TargetState.CONFIRMED, t_unix_ns=time.time_ns(), position_enu=lens[0] + [0.0, 0.0, ABOVE_M],
        velocity_enu=np.zeros(3), covariance=np.eye(6), cameras=NAMES, age_s=0.0, quality=1.0,
    )  # fmt: skip
    (target,) = TargetExport(NAMES, 2, 50.0).to_wgs84([estimate], positions.origin)
    context = MavlinkContext(
        positions.origin, 1, identity_of(MavlinkSection(), "hill", Path()), undulation_m=UNDULATION_M
    )
    drawn: common.MAVLink_adsb_vehicle_message = messages.adsb_vehicle(target, context)
    assert drawn.altitude / 1000 == pytest.approx(LENS.altitude_m + ABOVE_M, abs=0.003)
    assert (drawn.lat / 1e7, drawn.lon / 1e7) == pytest.approx((LENS.lat_deg, LENS.lon_deg), abs=2e-7)
    geodetic = enu_to_geodetic(estimate.position_enu[None], positions.origin)[0]
    assert geodetic[2] == pytest.approx(LENS.altitude_m + LENS.separation_m + ABOVE_M, abs=0.003)
