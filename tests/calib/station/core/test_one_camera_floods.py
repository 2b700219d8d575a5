"""One camera sends valid messages without end: what is beyond its share is not decoded, it is named, others go on."""

import random

import msgspec

from calib.station.core.intake import BURST_BYTES, MOST_BYTES_HZ
from edge.common.allowances import Allowances
from edge.messages import Tracks, encode
from tests.calib.station.conftest import Fed, station_for
from tools.doubles.box_messages import tracks_messages
from tools.doubles.flight import Spec, frames, make

NS = 10**9


def test_others_positions_are_the_same_and_the_flood_is_named() -> None:
    scene = make(Spec(cameras=4, uavs=2, rate_hz=10.0, duration_s=6.0))
    calm, flooded = (Fed(station_for(scene), scene, solves=False) for _ in range(2))
    for fed in (calm, flooded):
        fed.station.adopt(scene.network)
    seq = 10**6
    for sent in tracks_messages(scene, frames(scene)):
        if "/cam3/" not in sent.key:
            calm.take(sent)
            flooded.take(sent)
            continue
        tracks = msgspec.json.decode(sent.payload, type=Tracks)
        crowd = (tracks.detections * 59)[:59]  # one short of what is a flood in each frame
        for k in range(100):  # a thousand a second
            seq += 1
            told = msgspec.structs.replace(tracks, seq=seq, t_unix_ns=tracks.t_unix_ns + k * 10**6, detections=crowd)
            flooded.take(sent._replace(payload=encode(told), arrival_ns=sent.arrival_ns + k))
    assert flooded.station.intake.cameras["cam3"].counters["too_much"] > 2000
    reasons = [check.reason for check in flooded.station.intake.checks(flooded.station._frame_ns, 2.0)]
    assert any("more than 1.5 MB a second" in reason for reason in reasons)
    sent_calm = {target.track for _, target in calm.sent}
    assert sent_calm
    assert len(flooded.sent) > 0.8 * len(calm.sent)


def test_no_sequence_of_sizes_gets_more_than_its_share() -> None:
    draw = random.Random(3)
    budget, now_ns, taken = Allowances(MOST_BYTES_HZ, BURST_BYTES), 0, 0
    for _ in range(5000):
        now_ns += draw.choice([0, 1, 10**6, 10**8])
        size = draw.choice([1, 300, 20_000, 300_000, 1 << 20])
        taken += size * budget.take("cam0", now_ns / NS, size)
    assert taken <= BURST_BYTES + MOST_BYTES_HZ * now_ns / NS


def test_an_honest_camera_is_never_near_it() -> None:
    """A hundred frames a second of thirty objects, after a cut of a second."""
    budget = Allowances(MOST_BYTES_HZ, BURST_BYTES)
    assert all(budget.take("cam0", 0.0, 30 * 280) for _ in range(100))
    assert all(budget.take("cam0", (1 + k) / 100, 30 * 280) for k in range(3000))
