"""A camera that is another one every second clears itself: the others' evidence, solves and names stay.

The kind: whatever one box may say that makes it another camera (a lens that changes by a thousandth of a pixel or by a
tenth, a clock that goes back), again and again, while an honest camera is knocked.
"""

from collections.abc import Callable, Iterator

import msgspec
import pytest

from calib.station.core.jobs import Solved, SolveResult
from edge.messages import Lens, Tracks, camera_key, encode
from tests.calib.station.conftest import Fed, station_for
from tools.doubles.box_messages import SITE, Sent, tracks_messages
from tools.doubles.faults import KNOCKED, faulty_frames
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, make

NS = 10**9
BEGINS_S, EVENT_S = 4.0, 8.0
SPEC = Spec(cameras=5, uavs=2, rate_hz=15.0, duration_s=15.0)
LENS_OF = "cam0"


def unsteady(step_px: float, every_s: float = 1.0) -> Callable[[Scene, Iterator[Sent]], Iterator[Sent]]:
    def stream(scene: Scene, honest: Iterator[Sent]) -> Iterator[Sent]:
        lens, changes = Lens.of(scene.truth[0].lens), 0
        for sent in honest:
            if sent.arrival_ns > T0_UNIX_NS + (BEGINS_S + changes * every_s) * NS:
                changes += 1
                fx, fy, cx, cy = lens.intrinsics
                told = msgspec.structs.replace(lens, intrinsics=(fx + step_px * (changes % 2), fy, cx, cy))
                yield Sent(sent.arrival_ns, camera_key(SITE, LENS_OF, "lens"), encode(told))
            yield sent

    return stream


def set_back(scene: Scene, honest: Iterator[Sent]) -> Iterator[Sent]:
    """Each second its clock goes back by a minute."""
    for sent in honest:
        told_s = (sent.arrival_ns - T0_UNIX_NS) / NS - BEGINS_S
        if f"/{LENS_OF}/" not in sent.key or told_s < 0:
            yield sent
            continue
        tracks = msgspec.json.decode(sent.payload, type=Tracks)
        moved = msgspec.structs.replace(tracks, t_unix_ns=tracks.t_unix_ns - 60 * NS * (1 + int(told_s)))
        yield sent._replace(payload=encode(moved))


KINDS = {
    "lens, 0.001 px": unsteady(0.001),
    "lens, 100 px": unsteady(100.0),
    "lens, thrice a second": unsteady(0.1, 0.3),
}
KINDS["clock goes back"] = set_back


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_whoever_is_knocked_meanwhile_is_named_as_soon(kind: Callable[[Scene, Iterator[Sent]], Iterator[Sent]]) -> None:
    scene = make(SPEC)
    fed = Fed(station_for(scene), scene, solves=False)
    fed.station.adopt(scene.network)
    honest = tracks_messages(scene, faulty_frames(scene, KNOCKED, EVENT_S))
    named_s: dict[str, float] = {}
    for sent in kind(scene, honest):
        fed.take(sent)
        for camera in fed.station.calibration.suspects:
            named_s.setdefault(camera, (sent.arrival_ns - T0_UNIX_NS) / NS)
    assert set(named_s) == {LENS_OF, "cam2"}
    assert EVENT_S < named_s["cam2"] < EVENT_S + 5.0
    assert {"cam1", "cam3", "cam4"} <= set(fed.station.calibration.trusted)


def test_a_solve_under_way_goes_on_without_it() -> None:
    scene = make(SPEC)
    calibration = station_for(scene).calibration
    calibration._jobs = 3
    calibration.changed(LENS_OF, "its lens file was exchanged")
    network = calibration.take(SolveResult(3, Solved(scene.network, 0.1), None, 1.0))
    assert network is not None
    assert network.ids == {"cam1", "cam2", "cam3", "cam4"}
    for _ in range(20):
        calibration.changed("cam1", "its lens file was exchanged")
    assert calibration.suspects == {"cam1": "its lens file was exchanged"}
    assert calibration._jobs == 3, "nobody's work is thrown away"
