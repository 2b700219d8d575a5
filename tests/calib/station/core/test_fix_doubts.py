"""A box's position that somebody speaks against: its own box, or a fix that lies elsewhere. Nothing is sent on it."""

import numpy as np
import pytest
from msgspec.structs import replace

from calib.station.config import BaseConfig, CameraSection, SiteSection
from calib.station.core.calibration import Phase
from calib.station.core.intake import CameraIntake
from calib.station.core.positions import Positions
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from edge.messages import Fix, Health, camera_key, encode
from tools.doubles.box_messages import SITE, T0_UNIX_NS, fix_message, state_messages
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


def test_of_four_the_others_checked_it_and_one_box_silences_nobody() -> None:
    """What a camera says against its own position is no word against what three others bear out."""
    scene = make(Spec(cameras=4, uavs=1, rate_hz=10.0, duration_s=5.0))
    station = station_for(scene)
    for sent in state_messages(scene):
        station.handle(sent.key, sent.payload, NOW_NS)
    station.tick(NOW_NS)
    station.adopt(scene.network)
    names, fix = [camera.id for camera in scene.truth], fix_message(scene.truth[0])
    say(station, names[0], north(fix, 35.0))
    assert station.calibration.trusted == set(names[1:])
    assert station.calibration.suspects[names[0]].startswith("its position: it is 34.99")
    say(station, names[1], replace(fix_message(scene.truth[1]), standing="doubted", quality=0, why="doubted: carried"))
    assert station.calibration.trusted == set(), "of two nobody knows what the others checked"


def doubted(why: str = "doubted: jumps by 1.3 m") -> Fix:
    return replace(first_fix(), standing="doubted", quality=0, why=why)


def say_run(station: Station, epoch: int) -> None:
    """The first camera's box says how it is, in that run of its program."""
    health = Health(t_unix_ns=T0_UNIX_NS, epoch=epoch, level="ok", items=[], counters={})
    station.handle(camera_key(SITE, NAMES[0], "health"), encode(health), NOW_NS)


@pytest.mark.parametrize("run", [5, 6, 4])
def test_only_the_run_of_a_box_that_doubted_a_position_explains_another(run: int) -> None:
    """A base was switched, the box doubts, somebody restarts it: what it says then is its first word.

    Its clock may have been set back meanwhile, which numbers its runs.
    """
    station = calibrated()
    say_run(station, 5)
    say(station, NAMES[0], doubted())
    say_run(station, run)
    say(station, NAMES[0], north(first_fix(), 1.3))
    assert (sigma_m(station) < 0.1) is (run == 5)
    assert sigma_m(station) < 0.1 or sigma_m(station) > 1.29


def test_a_restarted_box_that_says_the_same_place_again_is_believed() -> None:
    station = calibrated()
    say(station, NAMES[0], doubted())
    say_run(station, 2)
    say(station, NAMES[0], north(first_fix(), 0.01))
    assert sigma_m(station) < 0.1


def test_a_station_that_comes_later_believes_no_stored_network_laid_on_a_doubted_position() -> None:
    station = station_for(SCENE, StoredState(network=SCENE.network))
    station.tick(NOW_NS)
    station.adopt(SCENE.network)
    say(station, NAMES[0], doubted())
    assert station.calibration.trusted == set()
    say(station, NAMES[0], doubted())
    assert station.intake.cameras[NAMES[0]].fix_doubts == 1, "said again it is the same doubt"


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


def test_only_the_cameras_without_a_position_are_asked_for_one() -> None:
    """Two of three have RTK: the operator is sent to the third, though the site has no place yet for want of it."""
    sections = {name: CameraSection(id=name) for name in NAMES}
    station = Station(BaseConfig(site=SiteSection(name=SITE), camera=list(sections.values())), sections, StoredState())
    for sent in state_messages(SCENE):
        if sent.key != camera_key(SITE, NAMES[2], "fix"):
            station.handle(sent.key, sent.payload, NOW_NS)
    station.tick(NOW_NS)
    assert station.standing.reason == f"{NAMES[2]}: no position known yet"
    assert [station.positions.known(name, box) for name, box in station.intake.cameras.items()] == [True, True, False]
