"""No status is green while the instrument is blind: said within 3 s, and taken back when frames come again."""

from collections.abc import Callable

from calib.station.core.calibration import Phase
from calib.station.core.station import NEEDED_CAMERAS
from tests.calib.station.conftest import Fed, station_for
from tools.doubles.box_messages import messages
from tools.doubles.flight import Spec, make

NS = 10**9
SPEC = Spec(cameras=4, uavs=1, rate_hz=10.0, duration_s=12.0)
SAID_WITHIN_S = 3.0


def standing_over_time(heard: Callable[[str, float], bool]) -> tuple[Fed, list[tuple[float, Phase]]]:
    """A calibrated station that is fed with some of the frames; its phase each tenth of a second."""
    scene = make(SPEC)
    fed = Fed(station_for(scene), scene)
    fed.station.adopt(scene.network)
    found: list[tuple[float, Phase]] = []
    begin_ns = 0
    for message in messages(scene):
        begin_ns = begin_ns or message.arrival_ns
        at_s = (message.arrival_ns - begin_ns) / NS
        if "/tracks" not in message.key or heard(message.key.split("/")[4], at_s):
            fed.take(message)
        else:
            fed.tick(message.arrival_ns)
        found.append((at_s, fed.station.standing.phase))
    return fed, found


def test_all_cameras_fall_silent_and_come_again() -> None:
    fed, phases = standing_over_time(lambda _, at_s: not 4.0 < at_s < 9.0)
    assert {phase for at_s, phase in phases if 2.0 < at_s < 4.0} == {Phase.CALIBRATED}
    assert {phase for at_s, phase in phases if 4.0 + SAID_WITHIN_S < at_s < 9.0} == {Phase.BLIND}
    assert phases[-1][1] is Phase.CALIBRATED
    assert any("no position can be sent: 0 of 4 cameras can be used, 2 must" in text for _, text in fed.said)


def test_one_camera_alone_is_blind_and_two_are_not() -> None:
    for seeing, phase in ((1, Phase.BLIND), (NEEDED_CAMERAS, Phase.CALIBRATED)):
        left = {f"cam{k}" for k in range(seeing)}
        fed, _ = standing_over_time(lambda camera, at_s, left=left: at_s < 4.0 or camera in left)
        assert fed.station.standing.phase is phase
        assert fed.station.health is not None
        level = next(item.level for item in fed.station.health.items if item.name == "calibration")
        assert level == ("fail" if phase is Phase.BLIND else "ok")
        if phase is Phase.BLIND:
            assert fed.station.standing.action == "look at the boxes, cameras and links of cam1, cam2, cam3"


def test_cameras_that_the_operator_left_out_do_not_count() -> None:
    scene = make(SPEC)
    fed = Fed(station_for(scene), scene)
    fed.station.adopt(scene.network)
    fed.station.muted |= {"cam0", "cam1", "cam2"}
    for message in messages(scene):
        fed.take(message)
    assert fed.station.standing.phase is Phase.BLIND
    assert fed.station.standing.action == "use more cameras"
