"""A recording with messages in it that nobody thought of: each is skipped, counted and named, and the rest is read."""

import random

import msgspec
import pytest

from calib.station.core.playback import Recorded, play
from edge.messages import Fix, Lens, Tracks, camera_key, encode
from tools.doubles.box_messages import SITE, messages
from tools.doubles.extremes import Extremes
from tools.doubles.flight import Spec, make

SCENE = make(Spec(cameras=3, uavs=2, rate_hz=10.0, duration_s=2.0))
SENT = list(messages(SCENE))
TYPES = {"tracks": Tracks, "lens": Lens, "fix": Fix}


@pytest.mark.parametrize(
    "bad",
    [
        {"distortion": [0.0, 0.0, 0.0]},
        {"distortion": [1e300] * 5},
        {"model": "fisheye", "distortion": [0.1]},
        {"intrinsics": (1e-300, 1e-300, 0.0, 0.0)},
        {"size_px": (1, 1)},
    ],
    ids=str,
)
def test_one_bad_lens_leaves_the_others_and_is_named(bad: dict[str, object]) -> None:
    lens = Lens.of(SCENE.truth[0].lens)
    said = encode(msgspec.structs.replace(lens, **bad))
    played = play([*(Recorded(*one) for one in _recorded()), Recorded(_key("lens"), SENT[-1].arrival_ns, said)])
    assert {site.id for site in played.scene.cameras} >= {"cam1", "cam2"}
    of_cam0 = [row for row in played.refused if row.camera == "cam0"]
    assert of_cam0, "counted, named, or its rows of before are another lens's"
    assert all(row.reason and row.action and row.count for row in of_cam0)


@pytest.mark.parametrize("seed", range(5))
def test_no_valid_message_stops_the_reader(seed: int) -> None:
    draw = random.Random(seed)
    extremes, stream = Extremes(draw), list[Recorded]()
    for key, arrival_ns, payload in _recorded():
        stream.append(Recorded(key, arrival_ns, payload))
        honest = msgspec.json.decode(payload, type=TYPES[key.rpartition("/")[2]])
        stream.append(Recorded(key, arrival_ns, encode(extremes.of(honest))))
    assert len(play(stream).scene.cameras) <= 3


def _recorded() -> list[tuple[str, int, bytes]]:
    return [(one.key, one.arrival_ns, one.payload) for one in SENT]


def _key(topic: str) -> str:
    return camera_key(SITE, "cam0", topic)
