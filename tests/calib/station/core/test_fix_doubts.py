"""A box's position that somebody speaks against: its own box, or a fix that lies elsewhere. Nothing is sent on it."""

import numpy as np
import pytest
from msgspec.structs import replace

from calib.station.config import CameraSection
from calib.station.core.calibration import Phase
from calib.station.core.intake import CameraIntake
from calib.station.core.positions import Positions
from calib.station.core.station import Station
from edge.messages import Fix, camera_key, encode
from tools.doubles.box_messages import SITE, T0_UNIX_NS, fix_message
from tools.doubles.core_station import station_for
from tools.doubles.flight import Spec, make

SCENE = make(Spec(cameras=3, uavs=1, rate_hz=10.0, duration_s=5.0))
NAMES = [camera.id for camera in SCENE.truth]
NOW_NS = T0_UNIX_NS + 10 * 10**9


def calibrated() -> Station:
    """A station with fixes of all cameras and the true network in force."""
    station = station_for(SCENE)
    for camera in SCENE.truth:
        say(station, camera.id, fix_message(camera))
    station.tick(NOW_NS)
    station.adopt(SCENE.network)
    return station


def say(station: Station, camera: str, fix: Fix) -> None:
    station.handle(camera_key(SITE, camera, "fix"), encode(fix), NOW_NS)


def first_fix() -> Fix:
    return fix_message(SCENE.truth[0])


def sigma_m(station: Station) -> float:
    """3-D sigma of the first camera's position, and infinity without one."""
    place = station.positions.of(NAMES[0], station.intake.cameras[NAMES[0]])
    return float("inf") if place is None else float(np.sqrt(np.trace(place[1])))


def lines(station: Station) -> list[tuple[str, str]]:
    station.tick(NOW_NS + 2 * 10**9)
    assert station.health is not None
    return [(item.level, item.reason) for item in station.health.items if item.name == f"position {NAMES[0]}"]


def north(fix: Fix, metres: float) -> Fix:
    return replace(fix, lat_deg=fix.lat_deg + metres / 111_200.0)


def test_a_box_that_takes_its_position_back_holds_back_the_network_laid_on_it() -> None:
    station = calibrated()
    assert station.calibration.trusted == set(NAMES)
    say(station, NAMES[0], replace(first_fix(), standing="doubted", quality=0, why="doubted: it was carried 35 m"))
    assert station.calibration.trusted == set()
    assert sigma_m(station) == float("inf")
    assert any(level == "fail" and "carried 35 m" in reason for level, reason in lines(station))
    assert station.standing.phase is Phase.SUSPECT
    assert "carried 35 m" in station.standing.reason
    say(station, NAMES[0], north(first_fix(), 35.0))  # it stands somewhere now, by its own word
    assert sigma_m(station) < 0.1


@pytest.mark.parametrize("metres", [0.15, 0.3, 1.3, 35.0])
def test_a_position_elsewhere_is_an_alarm_and_sigma_covers_both(metres: float) -> None:
    station = calibrated()
    say(station, NAMES[0], north(first_fix(), metres))
    assert station.calibration.trusted == set()
    assert sigma_m(station) > 0.99 * metres
    assert any(level == "fail" and "sigma covers both" in reason for level, reason in lines(station))
    say(station, NAMES[0], first_fix())
    assert sigma_m(station) > 0.99 * metres  # until the operator says


def test_a_position_that_is_refined_moves_nothing() -> None:
    station = calibrated()
    for k in range(1, 20):
        say(station, NAMES[0], north(first_fix(), 0.002 * (k % 5)))
    assert station.calibration.trusted == set(NAMES)
    assert lines(station) == []


def test_corrections_that_stop_leave_a_position_in_use_and_are_said() -> None:
    station = calibrated()
    lost = replace(first_fix(), standing="unconfirmed", quality=0, why="no fix: not RTK fixed (5: RTK float)")
    say(station, NAMES[0], lost)
    assert station.calibration.trusted == set(NAMES)
    assert sigma_m(station) < 0.1
    assert [level for level, _ in lines(station)] == ["warn"]


def test_a_station_that_comes_later_takes_no_position_that_nobody_stands_by() -> None:
    for standing in ("unconfirmed", "doubted"):
        station = station_for(SCENE)
        say(station, NAMES[0], replace(first_fix(), standing=standing, quality=0, why="no fix"))
        assert sigma_m(station) == float("inf")


def test_a_surveyed_position_stays_in_use_and_a_fix_elsewhere_is_said() -> None:
    fix, boxes = first_fix(), {name: CameraIntake(name) for name in NAMES}
    place = (fix.lat_deg, fix.lon_deg, fix.height_m)
    surveyed = CameraSection(id=NAMES[0], position=place, position_sigma=(0.01, 0.01, 0.02))
    positions = Positions({name: CameraSection(id=name) for name in NAMES} | {NAMES[0]: surveyed}, place)
    boxes[NAMES[0]].stand_by(north(fix, 1.3))
    used = positions.of(NAMES[0], boxes[NAMES[0]])
    assert used is not None
    assert used[0] == pytest.approx(np.zeros(3), abs=1e-6)
    assert any("surveyed position" in check.reason for check in positions.checks(boxes))
