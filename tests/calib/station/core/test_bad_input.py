"""Whatever a box sends: a clear sentence saying what, where and what to do; and nothing else stops."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.station.config import BaseConfig, CameraSection, SiteSection, load
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from edge.common.errors import ConfigError
from edge.messages import Tracks, camera_key, encode
from tests.calib.station.conftest import Change, Fed, station_for
from tools.doubles.box_messages import SITE, Sent, messages
from tools.doubles.flight import T0_UNIX_NS, Spec, make

SHORT = Spec(
    cameras=4, uavs=1, rate_hz=15.0, duration_s=22.0
)  # 15 s until the first solve, and some seconds of targets
NS = 10**9
Feed = Callable[..., Fed]


def on_tracks(camera: str, change: Callable[[Tracks, int], Tracks | None], after_s: float = 0.0) -> Change:
    """Change one camera's Tracks from some second on; `change` gets the message and its number."""
    count = 0

    def apply(sent: Sent) -> Iterator[Sent]:
        nonlocal count
        if sent.key != camera_key(SITE, camera, "tracks") or sent.arrival_ns < T0_UNIX_NS + after_s * NS:
            yield sent
            return
        count += 1
        changed = change(msgspec.json.decode(sent.payload, type=Tracks), count)
        if changed is not None:
            yield sent._replace(payload=encode(changed))

    return apply


def camera_reason(fed: Fed, camera: str) -> tuple[str, str]:
    """Level and sentence of a camera's health."""
    assert fed.station.health is not None
    item = next(item for item in fed.station.health.items if item.name == f"camera {camera}")
    assert item.level == "ok" or item.action, "an alarm says what to do"
    return item.level, item.reason


def still_works(fed: Fed) -> None:
    """The others go on: targets are sent to the end, and they are where the objects are."""
    assert fed.sent, fed.station.standing
    assert fed.sent[-1][0] > SHORT.duration_s - 1.0
    # 1 px at 120 m and f = 1300 px is 0.1 m a ray; 1 m is far outside of it and far inside a wrong target.
    assert fed.errors_m().max() < 1.0


def test_a_healthy_site_sends_targets(feed: Feed) -> None:
    fed = feed(SHORT)
    still_works(fed)
    assert [phase for _, phase in fed.phases] == ["collecting", "calibrated"]


def test_boxes_without_a_size_are_followed_and_guarded_like_others(feed: Feed) -> None:
    """What is replayed from a track folder has none, and a share of nothing is no number."""

    def points(sent: Sent) -> Iterator[Sent]:
        if not sent.key.endswith("/tracks"):
            yield sent
            return
        message = msgspec.json.decode(sent.payload, type=Tracks)
        bare = [msgspec.structs.replace(one, width_px=0.0, height_px=0.0) for one in message.detections]
        yield sent._replace(payload=encode(msgspec.structs.replace(message, detections=bare)))

    fed = feed(SHORT, points)
    still_works(fed)
    assert [phase for _, phase in fed.phases] == ["collecting", "calibrated"]


def test_tracks_of_an_unknown_camera_are_named(feed: Feed) -> None:
    def also_as_cam9(sent: Sent) -> Iterator[Sent]:
        yield sent
        yield sent._replace(key=sent.key.replace("/cam0/", "/cam9/"))

    fed = feed(SHORT, also_as_cam9)
    still_works(fed)
    level, reason = camera_reason(fed, "cam9")
    assert (level, "not configured" in reason) == ("warn", True)


def test_absurd_pixels_are_dropped_and_named(feed: Feed) -> None:
    def far_off(tracks: Tracks, _: int) -> Tracks:
        wild = [msgspec.structs.replace(d, u_px=9e4) for d in tracks.detections]
        return msgspec.structs.replace(tracks, detections=tracks.detections + wild)

    fed = feed(SHORT, on_tracks("cam1", far_off))
    still_works(fed)
    assert "outside its 1920 x 1080 image" in camera_reason(fed, "cam1")[1]


def test_not_a_number_and_not_a_message_are_counted(feed: Feed) -> None:
    def garbage(sent: Sent) -> Iterator[Sent]:
        yield sent
        if "/cam1/tracks" in sent.key:
            for payload in (b"", b"\xff\xfe", b'{"t_unix_ns": 1', sent.payload.replace(b'"u_px":', b'"u_px":NaN,"x":')):
                yield sent._replace(payload=payload)

    fed = feed(SHORT, garbage)
    still_works(fed)
    assert fed.station.intake.cameras["cam1"].counters["undecodable"] > 1000
    assert "not a Tracks message" in camera_reason(fed, "cam1")[1]


@pytest.mark.parametrize("ahead_s", [0.6, 1.0, 1.9])
def test_a_box_ahead_that_sees_nothing_is_named_and_stops_nobody(feed: Feed, ahead_s: float) -> None:
    def ahead(tracks: Tracks, _: int) -> Tracks:
        return msgspec.structs.replace(tracks, t_unix_ns=tracks.t_unix_ns + round(ahead_s * NS), detections=[])

    fed = feed(SHORT, on_tracks("cam0", ahead, after_s=8.0))
    still_works(fed)
    level, reason = camera_reason(fed, "cam0")
    assert (level, f"{ahead_s:.1f} s ahead of the other cameras'" in reason) == ("warn", True)
    assert [camera_reason(fed, camera)[0] for camera in ("cam1", "cam2", "cam3")] == ["ok"] * 3


def test_a_clock_in_the_future_is_left_out_and_the_others_go_on(feed: Feed) -> None:
    ahead = on_tracks("cam2", lambda t, _: msgspec.structs.replace(t, t_unix_ns=t.t_unix_ns + 3600 * NS))
    fed = feed(SHORT, ahead)
    still_works(fed)
    level, reason = camera_reason(fed, "cam2")
    assert level == "warn"
    assert "3600.0 s in the future" in reason


def test_the_first_camera_to_speak_may_be_the_one_in_the_future(feed: Feed) -> None:
    ahead = on_tracks("cam0", lambda t, _: msgspec.structs.replace(t, t_unix_ns=t.t_unix_ns + 10 * 365 * 86400 * NS))
    still_works(feed(SHORT, ahead))


def test_times_that_jitter_backwards_are_dropped_and_named(feed: Feed) -> None:
    def back(tracks: Tracks, number: int) -> Tracks:
        return msgspec.structs.replace(tracks, t_unix_ns=tracks.t_unix_ns - (NS if number % 5 == 0 else 0))

    fed = feed(SHORT, on_tracks("cam3", back))
    still_works(fed)
    assert "went back" in camera_reason(fed, "cam3")[1]


def test_rows_that_a_box_marks_as_late_are_no_fault_of_its_clock(feed: Feed) -> None:
    def late(tracks: Tracks, number: int) -> Tracks:
        return (
            msgspec.structs.replace(tracks, t_unix_ns=tracks.t_unix_ns - NS, late=True) if number % 5 == 0 else tracks
        )

    fed = feed(SHORT, on_tracks("cam3", late))
    still_works(fed)
    assert camera_reason(fed, "cam3")[0] == "ok"
    assert fed.station.intake.cameras["cam3"].counters["late"] > 10


def test_a_clock_set_back_leaves_its_camera_out_by_name(feed: Feed) -> None:
    back = on_tracks("cam3", lambda t, _: msgspec.structs.replace(t, t_unix_ns=t.t_unix_ns - 60 * NS), after_s=7.0)
    fed = feed(SHORT, back)
    still_works(fed)
    assert fed.station.calibration.suspects == {"cam3": "its clock was set"}


def test_a_lens_file_of_another_resolution_is_refused_and_named(feed: Feed) -> None:
    half = on_tracks("cam1", lambda t, _: msgspec.structs.replace(t, size_px=(960, 540)))
    fed = feed(SHORT, half)
    still_works(fed)
    assert "frames are 960 x 540, the lens file is for 1920 x 1080" in camera_reason(fed, "cam1")[1]


def test_interpolated_rows_are_never_measurements(feed: Feed) -> None:
    def all_invented(tracks: Tracks, _: int) -> Tracks:
        rows = [msgspec.structs.replace(d, status="interpolated") for d in tracks.detections]
        return msgspec.structs.replace(tracks, detections=rows)

    fed = feed(SHORT, on_tracks("cam0", all_invented))
    assert len(fed.station.window.cameras["cam0"]) == 0
    assert fed.station.intake.cameras["cam0"].counters["interpolated"] > 100
    assert all("cam0" not in target.cameras for _, target in fed.sent)


def test_two_boxes_with_one_name_are_noticed(feed: Feed) -> None:
    def twins(tracks: Tracks, number: int) -> Tracks:
        return msgspec.structs.replace(tracks, epoch=1 + number % 2)

    fed = feed(SHORT, on_tracks("cam1", twins))
    still_works(fed)
    assert "two boxes send under this name" in camera_reason(fed, "cam1")[1]


def test_a_box_that_restarts_is_no_twin(feed: Feed) -> None:
    def restart(tracks: Tracks, number: int) -> Tracks:
        return msgspec.structs.replace(tracks, epoch=2, seq=number)

    fed = feed(SHORT, on_tracks("cam1", restart, after_s=6.0))
    still_works(fed)
    assert camera_reason(fed, "cam1")[0] == "ok"
    assert fed.station.calibration.suspects == {}


def test_repeated_and_lost_messages_are_counted_once(feed: Feed) -> None:
    def again(sent: Sent) -> Iterator[Sent]:
        yield sent
        yield sent

    fed = feed(replace(SHORT, duration_s=2.0), again)
    cam0 = fed.station.intake.cameras["cam0"]
    assert cam0.counters["repeated"] == cam0.next_seq == 30
    assert cam0.counters["missed"] == 0


def test_silence_is_a_fault_within_seconds(feed: Feed) -> None:
    fed = feed(SHORT, on_tracks("cam2", lambda *_: None, after_s=6.0))
    still_works(fed)
    level, reason = camera_reason(fed, "cam2")
    assert level == "fail"
    assert "last frame" in reason


@pytest.mark.parametrize("late_s", [0.0, 600.0])
def test_the_base_may_start_before_or_long_after_the_boxes(late_s: float) -> None:
    """Stamps are compared with each other, never with the station's own clock or start."""
    scene = make(SHORT)
    fed = Fed(station_for(scene), scene)
    started_ns = T0_UNIX_NS - 30 * NS if late_s == 0 else T0_UNIX_NS
    fed.tick(started_ns)
    fed.tick(T0_UNIX_NS - NS)
    for sent in messages(scene):
        later_ns = sent.arrival_ns + int(late_s * NS)
        payload = sent.payload
        if sent.key.endswith("/tracks") and late_s:  # the box has long been counting
            tracks = msgspec.json.decode(payload, type=Tracks)
            payload = encode(msgspec.structs.replace(tracks, seq=tracks.seq + 100_000))
        fed.take(sent._replace(arrival_ns=later_ns, payload=payload))
    assert fed.sent
    assert fed.errors_m().max() < 1.0


def test_fewer_than_three_cameras_in_the_configuration_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "base.toml"
    path.write_text('[site]\nname = "x"\n[[camera]]\nid = "a"\n[[camera]]\nid = "b"\n')
    with pytest.raises(ConfigError, match="2 cameras are named; name 3 to"):
        load(path)


def test_a_camera_named_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "base.toml"
    path.write_text('[site]\nname = "x"\n' + '[[camera]]\nid = "a"\n' * 3)
    with pytest.raises(ConfigError, match="camera 'a' is named twice"):
        load(path)


def test_only_two_cameras_that_see_wait_and_say_for_what(feed: Feed) -> None:
    def blind(sent: Sent) -> Iterator[Sent]:
        yield from () if "/cam2/tracks" in sent.key or "/cam3/tracks" in sent.key else (sent,)

    fed = feed(SHORT, blind)
    assert not fed.sent
    assert "waiting for an object that" in fed.station.standing.reason


@given(payload=st.binary(max_size=300), topic=st.sampled_from(["tracks", "lens", "fix", "health", "x", ""]))
def test_no_bytes_stop_the_station(payload: bytes, topic: str) -> None:
    sections = [CameraSection(id=f"cam{k}") for k in range(3)]
    config = BaseConfig(site=SiteSection(name=SITE), camera=sections)
    station = Station(config, {section.id: section for section in sections}, StoredState())
    assert station.handle(camera_key(SITE, "cam0", topic), payload, T0_UNIX_NS) == []
    assert station.tick(T0_UNIX_NS).targets == []


def test_nothing_is_sent_by_a_station_that_knows_nothing(feed: Feed) -> None:
    fed = feed(replace(SHORT, duration_s=8.0), solves=False)
    assert not fed.sent
    assert np.isfinite(fed.station.now_unix_ns(T0_UNIX_NS))
