"""What the station sends is as uncertain as its place on the Earth; what it computes with is not."""

import numpy as np
import pytest
from msgspec.structs import replace

from calib.reference_frame import ReferenceFrame
from calib.station.config import CameraSection
from calib.station.core.intake import CameraIntake
from calib.station.core.outgoing import UPPER
from calib.station.core.positions import Positions
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from calib.station.outputs.mavlink.messages import Identity, MavlinkContext, target_track_ecef
from edge.messages import Fix, decode, encode
from tests.calib.station.conftest import Fed, station_for
from tools.doubles.box_messages import Sent, fix_message, messages
from tools.doubles.flight import ORIGIN, T0_UNIX_NS, Scene, Spec, make

SCENE = make(Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=8.0))


def flown(frame: str, scene: Scene = SCENE) -> Fed:
    """A station whose boxes' fixes are all said to be in `frame`."""
    fed = Fed(station_for(scene), scene)
    for sent in messages(scene):
        labelled = sent
        if sent.key.endswith("/fix"):
            labelled = Sent(
                sent.arrival_ns, sent.key, encode(replace(decode(sent.payload, Fix, where="test"), frame=frame))
            )
        fed.take(labelled)
    return fed


def position_sigma_m(covariance: list[float]) -> np.ndarray:
    whole = np.zeros((6, 6))
    whole[UPPER] = covariance
    return np.sqrt(np.linalg.eigvalsh(whole[:3, :3], UPLO="U"))


@pytest.mark.parametrize("frame", ["WGS84", "unknown", ""])
def test_an_unknown_frame_widens_all_that_is_sent_and_nothing_that_is_computed(frame: str) -> None:
    known, unknown = flown("ITRF2020"), flown(frame)
    assert len(known.sent) == len(unknown.sent) > 50
    for (_, one), (_, other) in zip(known.sent, unknown.sent, strict=True):
        assert np.array_equal(one.position_enu, other.position_enu)
        added = other.covariance - one.covariance
        assert added[:3, :3] == pytest.approx(np.eye(3), abs=1e-9), "a metre along each axis"
        assert not added[3:].any()
        assert other.sigma_m == pytest.approx(np.hypot(one.sigma_m, 1.0))
        assert other.degraded is one.degraded
    for a, b in zip(tracked(known.station), tracked(unknown.station), strict=True):
        assert np.array_equal(a, b)
    places = [fed.station.positions.of("cam0", fed.station.intake.cameras["cam0"]) for fed in (known, unknown)]
    assert places[0] is not None
    assert places[1] is not None
    assert np.array_equal(places[0][1], places[1][1])


def tracked(station: Station) -> list[np.ndarray]:
    assert station.tracker is not None
    return [estimate.covariance for estimate in station.tracker.estimates(station.tracker.newest_s)]


def test_mavlink_and_zenoh_say_the_same() -> None:
    fed = flown("WGS84")
    targets = fed.station.targets(fed.station.now_unix_ns(T0_UNIX_NS + 8 * 10**9))
    assert targets is not None
    assert position_sigma_m(targets.targets[0].covariance).min() > 1.0
    identity = Identity(156, 25, icao_first=1, icao_count=255, callsign="SKY")
    message = target_track_ecef(fed.sent[-1][1], MavlinkContext(ORIGIN, 1, identity), True)
    assert position_sigma_m(list(message.cov)).min() > 1.0


def test_what_is_too_uncertain_is_judged_within_the_site() -> None:
    """A limit below the metre that the frame adds would silence every site that has not named its frame."""
    fed = Fed(station_for(SCENE), SCENE)
    tight = replace(fed.station.config.tracking, max_sigma_m=0.9)
    sections = {camera.id: CameraSection(id=camera.id) for camera in SCENE.truth}
    fed.station = Station(replace(fed.station.config, tracking=tight), sections, StoredState())
    for sent in messages(SCENE):
        fed.take(sent)
    assert fed.sent


def test_the_frame_is_that_of_the_positions_in_use() -> None:
    """A surveyed position's, and only else its box's fix; one that is not known is enough."""
    surveyed = CameraSection(id="cam0", position=ORIGIN)
    cameras = {"cam0": surveyed, "cam1": CameraSection(id="cam1"), "cam2": CameraSection(id="cam2")}
    boxes = {name: CameraIntake(name) for name in cameras}
    assert not Positions(cameras, ORIGIN).frame(boxes).known
    positions = Positions(cameras, ORIGIN, {"cam0": ReferenceFrame("ETRS89")})
    assert positions.frame(boxes).label == "ETRS89"
    for name, camera in zip(cameras, SCENE.truth, strict=True):
        boxes[name].fix = replace(fix_message(camera), frame="WGS84" if name == "cam0" else "ETRS89")
    assert positions.frame(boxes).known, "of a surveyed camera the box's label says nothing"
    assert said(positions, boxes) == ("ok", "the positions are in ETRS89, and so is all that is sent")
    boxes["cam1"].fix = replace(fix_message(SCENE.truth[1]), frame="WGS84")
    assert positions.frame(boxes).sigma_m == 1.0
    assert "not known (WGS84): 1 m is added" in said(positions, boxes)[1]


def test_positions_in_two_frames_are_named() -> None:
    cameras = {name: CameraSection(id=name, position=ORIGIN) for name in ("cam0", "cam1")}
    frames = {"cam0": ReferenceFrame("ETRS89"), "cam1": ReferenceFrame("NAD83(2011)")}
    boxes = {name: CameraIntake(name) for name in cameras}
    level, reason = said(Positions(cameras, ORIGIN, frames), boxes)
    assert level == "warn"
    assert "cam0 is in ETRS89, cam1 is in NAD83(2011)" in reason


def said(positions: Positions, boxes: dict[str, CameraIntake]) -> tuple[str, str]:
    (check,) = positions.frame_checks(boxes)
    return check.level, check.reason
