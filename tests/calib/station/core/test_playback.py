"""The same messages give the same scene: live, and from the recording that was made of them."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from calib.geodesy import enu_to_geodetic
from calib.observations import Scene, SiteCamera
from calib.station.archive import recording
from calib.station.archive.recording import Recorder
from calib.station.config import BaseConfig, CameraSection, SiteSection
from calib.station.core.playback import Played, Recorded, play
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from calib.station.core.surveyed_site import SurveyedSite
from edge.common.errors import ConfigError
from edge.messages import Fix, Lens, Tracks, camera_key, encode, station_key
from tools.doubles.box_messages import SITE, Sent, messages
from tools.doubles.flight import ORIGIN, T0_UNIX_NS, Spec, make

NS = 10**9
SPEC = Spec(cameras=4, uavs=1, rate_hz=10.0, duration_s=6.0, noise_px=0.5)
MIDDLE = 30  # number of a frame
Change = Callable[[Sent], Iterator[Sent]]


def on_tracks(camera: str, change: Callable[[Tracks], Tracks | None]) -> Change:
    """Change one camera's Tracks; None drops one."""

    def apply(sent: Sent) -> Iterator[Sent]:
        if sent.key != camera_key(SITE, camera, "tracks"):
            yield sent
            return
        changed = change(msgspec.json.decode(sent.payload, type=Tracks))
        if changed is not None:
            yield sent._replace(payload=encode(changed))

    return apply


def on_state(camera: str, topic: str, kind: type[msgspec.Struct], **fields: object) -> Change:
    """Change one camera's lens or fix."""

    def apply(sent: Sent) -> Iterator[Sent]:
        if sent.key == camera_key(SITE, camera, topic):
            sent = sent._replace(
                payload=encode(msgspec.structs.replace(msgspec.json.decode(sent.payload, type=kind), **fields))
            )
        yield sent

    return apply


def at(frame: Tracks, number: int, **fields: object) -> Tracks:
    """From frame `number` on another."""
    return msgspec.structs.replace(frame, **fields) if frame.seq >= number else frame


def once(frame: Tracks, number: int, **fields: object) -> Tracks:
    """Frame `number` alone another."""
    return msgspec.structs.replace(frame, **fields) if frame.seq == number else frame


def reaching_out(frame: Tracks, share: float) -> Tracks:
    """With a row beside the image, by a share of its width."""
    beside = msgspec.structs.replace(frame.detections[0], u_px=1920 * (1 + share), track=99)
    return msgspec.structs.replace(frame, detections=[*frame.detections, beside])


def invented(frame: Tracks) -> Tracks:
    """Every row of it interpolated."""
    rows = [msgspec.structs.replace(row, status="interpolated") for row in frame.detections]
    return once(frame, MIDDLE, detections=rows)


def repeated(sent: Sent) -> Iterator[Sent]:
    """Everything twice."""
    yield sent
    yield sent


def from_cam9_too(sent: Sent) -> Iterator[Sent]:
    """A box that the configuration does not name."""
    yield sent
    yield sent._replace(key=sent.key.replace("/cam0/", "/cam9/"))


def lens_exchanged(sent: Sent) -> Iterator[Sent]:
    """cam0 gets another lens file in the middle of the flight."""
    if sent.key == camera_key(SITE, "cam0", "lens"):
        lens = msgspec.json.decode(sent.payload, type=Lens)
        other = msgspec.structs.replace(lens, intrinsics=(1310.0, 1310.0, 960.0, 540.0))
        yield sent
        lens_exchanged.later = sent._replace(payload=encode(other))  # type: ignore[attr-defined]
        return
    yield sent
    if sent.key == camera_key(SITE, "cam0", "tracks") and b'"seq":30,' in sent.payload:
        yield lens_exchanged.later._replace(arrival_ns=sent.arrival_ns)  # type: ignore[attr-defined]


# What a box may send, and how many rows of cam0 and whether a position are left of it by both ways.
DIFFERENCES: dict[str, tuple[Change, int, bool]] = {
    "nothing": (lambda sent: iter([sent]), 60, True),
    "a fix that is not fixed": (on_state("cam0", "fix", Fix, quality=5), 60, False),
    "a fix that claims a millimetre": (on_state("cam0", "fix", Fix, sigma_m=(0.001, 0.001, 0.001)), 60, True),
    "a fix of the antenna": (on_state("cam0", "fix", Fix, of="antenna"), 60, True),
    "a pixel 7 % outside": (on_tracks("cam0", lambda t: reaching_out(t, 0.07)), 60, True),
    "a pixel 4 % outside": (on_tracks("cam0", lambda t: reaching_out(t, 0.04)), 120, True),
    "frames of another resolution": (on_tracks("cam0", lambda t: at(t, MIDDLE, size_px=(1280, 720))), 30, True),
    "one frame a day ahead": (
        on_tracks("cam0", lambda t: once(t, MIDDLE, t_unix_ns=t.t_unix_ns + 86400 * NS)), 59, True,
    ),
    "a clock set back": (on_tracks("cam0", lambda t: at(t, MIDDLE, t_unix_ns=t.t_unix_ns - 60 * NS)), 30, True),
    "a jitter backwards": (on_tracks("cam0", lambda t: once(t, MIDDLE, t_unix_ns=t.t_unix_ns - NS)), 59, True),
    "a new start of the box": (on_tracks("cam0", lambda t: at(t, MIDDLE, epoch=2)), 60, True),
    "an interpolated frame": (on_tracks("cam0", invented), 59, True),
    "a lost frame": (on_tracks("cam0", lambda t: None if t.seq == MIDDLE else t), 59, True),
    "everything twice": (repeated, 60, True),
    "a stranger": (from_cam9_too, 60, True),
    "another lens file": (lens_exchanged, 29, True),
    "a rolling shutter": (on_tracks("cam0", lambda t: msgspec.structs.replace(t, readout_s=0.02)), 60, True),
    "a shutter nobody knows": (on_tracks("cam0", lambda t: msgspec.structs.replace(t, readout_s=None)), 60, True),
}  # fmt: skip


@pytest.fixture(scope="module")
def sent() -> list[Sent]:
    """What the boxes send when all is well."""
    return list(messages(make(SPEC)))


def site(**cameras: CameraSection) -> SurveyedSite:
    """The configured site."""
    sections = {f"cam{k}": CameraSection(id=f"cam{k}") for k in range(SPEC.cameras)} | cameras
    return SurveyedSite(SITE, ORIGIN, sections)


def station_of(known: SurveyedSite) -> Station:
    section = SiteSection(name=known.name, origin=known.origin)
    config = BaseConfig(site=section, camera=list(known.cameras.values()))
    return Station(config, known.cameras, StoredState())


def both_ways(known: SurveyedSite, sent: Iterable[Sent], folder: Path) -> tuple[Scene, Played]:
    """The scene that a live station has at the end, and the one that its recording gives."""
    station, recorder = station_of(known), Recorder(folder, known.name, min_free_mb=1)
    recorder.hold(station_key(SITE, "survey"), encode(known.message(T0_UNIX_NS)))
    for message in sent:
        recorder.write(message.key, message.payload, message.arrival_ns)
        station.handle(message.key, message.payload, message.arrival_ns)
        station.tick(message.arrival_ns)
    recorder.close()
    assert recorder.path is not None
    boxes = station.intake.cameras
    cameras = [site for name in boxes if (site := station.positions.site_camera(name, boxes[name])) is not None]
    observations = {camera.id: station.window.cameras[camera.id].observations() for camera in cameras}
    assert station.positions.origin is not None
    live = Scene(known.name, station.positions.origin, tuple(cameras), observations)
    return live, play(recording.read(recorder.path))


def assert_same(one: Scene, two: Scene) -> None:
    """The same to the last bit."""
    assert (one.site, one.origin) == (two.site, two.origin)
    assert [camera.id for camera in one.cameras] == [camera.id for camera in two.cameras]
    for a, b in zip(one.cameras, two.cameras, strict=True):
        assert (a.lens, a.readout_s, a.clock_bound_s) == (b.lens, b.readout_s, b.clock_bound_s)
        for x, y in ((a.position_enu, b.position_enu), (a.position_covariance, b.position_covariance)):
            assert (x is None) == (y is None)
            assert x is None or y is None or np.array_equal(x, y)
    for name, rows in one.observations.items():
        other = two.observations[name]
        assert np.array_equal(rows.t_unix_ns, other.t_unix_ns)
        assert np.array_equal(rows.pixels, other.pixels)
        assert np.array_equal(rows.track, other.track)


@pytest.mark.parametrize("difference", DIFFERENCES)
def test_a_recording_is_read_as_it_was_live(difference: str, sent: list[Sent], tmp_path: Path) -> None:
    change, rows, placed = DIFFERENCES[difference]
    live, played = both_ways(site(), (changed for message in sent for changed in change(message)), tmp_path)
    assert_same(live, played.scene)
    cam0 = played.scene.cameras[0]
    assert len(played.scene.observations["cam0"]) == rows
    assert (cam0.position_enu is not None) == placed


def test_what_is_surveyed_counts_before_a_fix_by_both_ways(sent: list[Sent], tmp_path: Path) -> None:
    elsewhere = CameraSection(id="cam1", position=(47.41, 8.51, 590.0), position_sigma=(0.01, 0.01, 0.03))
    live, played = both_ways(site(cam1=elsewhere), sent, tmp_path)
    assert_same(live, played.scene)
    covariance = played.scene.cameras[1].position_covariance
    assert covariance is not None
    assert np.sqrt(np.diag(covariance)) == pytest.approx((0.01, 0.01, 0.03))


def test_no_receiver_is_better_than_five_millimetres(sent: list[Sent], tmp_path: Path) -> None:
    change, _, _ = DIFFERENCES["a fix that claims a millimetre"]
    _, played = both_ways(site(), (changed for message in sent for changed in change(message)), tmp_path)
    covariance = played.scene.cameras[0].position_covariance
    assert covariance is not None
    assert np.sqrt(np.diag(covariance)).min() >= 0.005


def recorded(sent: Iterable[Sent]) -> list[Recorded]:
    return [Recorded(message.key, message.arrival_ns, message.payload) for message in sent]


def refusals(played: Played) -> dict[str, str]:
    return {refusal.camera: f"{refusal.count} {refusal.reason}" for refusal in played.refused}


def test_what_is_refused_is_named_with_what_to_do(sent: list[Sent]) -> None:
    change = on_tracks("cam3", lambda t: once(t, MIDDLE, t_unix_ns=t.t_unix_ns + 86400 * NS))
    played = play(recorded(m for message in sent for m in change(message)), site())
    (refusal,) = played.refused
    assert "86400.0 s in the future" in str(refusal)
    assert "(chrony)" in refusal.action


def test_without_a_survey_every_camera_is_taken_where_its_fix_says(sent: list[Sent]) -> None:
    played = play(recorded(sent))
    assert [camera.id for camera in played.scene.cameras] == ["cam0", "cam1", "cam2", "cam3"]
    truth = make(SPEC).truth
    places = [
        enu_to_geodetic(c.position_enu, played.scene.origin)[0]
        for c in played.scene.cameras
        if c.position_enu is not None
    ]
    assert np.array(places) == pytest.approx(enu_to_geodetic(np.array([c.centre_enu for c in truth]), ORIGIN), abs=1e-7)


def test_a_survey_given_replaces_the_recorded_one_and_names_who_is_left_out(sent: list[Sent]) -> None:
    head = Recorded(station_key(SITE, "survey"), T0_UNIX_NS, encode(site().message(T0_UNIX_NS)))
    three = SurveyedSite(SITE, ORIGIN, {f"cam{k}": CameraSection(id=f"cam{k}") for k in range(3)})
    played = play([head, *recorded(sent)], three)
    assert [camera.id for camera in played.scene.cameras] == ["cam0", "cam1", "cam2"]
    assert "does not name it" in refusals(played)["cam3"]


def test_a_configuration_of_another_site_is_refused(sent: list[Sent]) -> None:
    with pytest.raises(ConfigError, match="of site 'meadow', the recording of 'bench'"):
        play(recorded(sent), replace(site(), name="meadow"))


def test_a_camera_that_never_said_its_lens_is_left_out_by_name(sent: list[Sent]) -> None:
    played = play(recorded(m for m in sent if m.key != camera_key(SITE, "cam2", "lens")), site())
    assert played.without_lens == ("cam2",)
    assert [camera.id for camera in played.scene.cameras] == ["cam0", "cam1", "cam3"]


def late_ones(sent: Sent) -> Iterator[Sent]:
    """Each fifth frame of cam0 said a second later, marked as late."""
    if sent.key == camera_key(SITE, "cam0", "tracks"):
        tracks = msgspec.json.decode(sent.payload, type=Tracks)
        if tracks.seq % 5 == 4:
            sent = sent._replace(
                payload=encode(msgspec.structs.replace(tracks, late=True, t_unix_ns=tracks.t_unix_ns - NS + 7))
            )
    yield sent


def test_rows_that_came_late_count_for_solve_and_not_live(sent: list[Sent], tmp_path: Path) -> None:
    live, played = both_ways(site(), (m for message in sent for m in late_ones(message)), tmp_path)
    assert len(live.observations["cam0"]) == 48
    rows = played.scene.observations["cam0"]
    assert len(rows) == 60
    assert np.all(np.diff(rows.t_unix_ns) >= 0)
    assert played.refused == ()


def backlog(sent: list[Sent], change: Callable[[Tracks], Tracks]) -> list[Recorded]:
    """cam0's link is cut for frames 20 to 29; its box says them again at the end."""
    key = camera_key(SITE, "cam0", "tracks")
    cut = [m for m in sent if m.key == key and 20 <= msgspec.json.decode(m.payload, type=Tracks).seq < 30]
    rest = recorded(m for m in sent if m not in cut)
    again = [encode(change(msgspec.json.decode(m.payload, type=Tracks))) for m in cut]
    end_ns = rest[-1].t_arrival_ns
    return rest + [Recorded(camera_key(SITE, "cam0", "backlog"), end_ns, payload) for payload in again]


def test_the_backlog_counts_once_however_often_it_comes(sent: list[Sent]) -> None:
    whole = backlog(sent, lambda tracks: tracks)
    again = [
        message._replace(key=message.key.replace("/tracks", "/backlog")) for message in whole if "/cam0/" in message.key
    ]
    played = play([*whole, *(message for message in again if message.key.endswith("/backlog"))], site())
    assert_same(play(recorded(sent), site()).scene, played.scene)


def test_a_row_of_the_backlog_may_be_of_any_past_but_of_no_future(sent: list[Sent]) -> None:
    ahead = play(backlog(sent, lambda t: msgspec.structs.replace(t, t_unix_ns=t.t_unix_ns + 86400 * NS)), site())
    assert len(ahead.scene.observations["cam0"]) == 50
    assert "in the future" in refusals(ahead)["cam0"]
    past = play(backlog(sent, lambda t: msgspec.structs.replace(t, t_unix_ns=t.t_unix_ns - 3600 * NS)), site())
    assert len(past.scene.observations["cam0"]) == 60


def test_what_comes_late_of_another_clock_is_not_mixed_in(sent: list[Sent]) -> None:
    messages_ = backlog(sent, lambda tracks: tracks)
    key = camera_key(SITE, "cam0", "tracks")

    def set_back(message: Recorded) -> Recorded:
        tracks = msgspec.json.decode(message.payload, type=Tracks) if message.key == key else None
        if tracks is None or tracks.seq < 40:
            return message
        return message._replace(payload=encode(msgspec.structs.replace(tracks, t_unix_ns=tracks.t_unix_ns - 60 * NS)))

    played = play(map(set_back, messages_), site())
    assert len(played.scene.observations["cam0"]) == 20
    reasons = [refusal.reason for refusal in played.refused]
    assert any("from before its clock was set came late" in reason for reason in reasons)


def test_cameras_hours_apart_are_all_kept_where_nobody_knows_when_their_rows_came(sent: list[Sent]) -> None:
    hours = {"cam1": 25 * NS, "cam2": -7200 * NS}

    def apart(message: Recorded) -> Recorded:
        camera = message.key.split("/")[4]
        if not message.key.endswith("/tracks"):
            return message
        tracks = msgspec.json.decode(message.payload, type=Tracks)
        shifted = msgspec.structs.replace(tracks, t_unix_ns=tracks.t_unix_ns + hours.get(camera, 0))
        return message._replace(payload=encode(shifted))

    shifted = [apart(message) for message in recorded(sent)]
    played = play(shifted, site(), arrivals_are_real=False)
    assert {len(rows) for rows in played.scene.observations.values()} == {60}
    assert played.refused == ()
    # With arrivals they are refused, as live; but for those before two others were there to contradict it.
    assert len(play(shifted, site()).scene.observations["cam1"]) < 3


def test_nothing_is_thinned_however_long_the_recording() -> None:
    lens_and_fix = [m for m in recorded(messages(make(replace(SPEC, duration_s=0.2)))) if not m.key.endswith("/tracks")]
    frame = msgspec.json.decode(next(m for m in messages(make(SPEC)) if m.key.endswith("/tracks")).payload, type=Tracks)
    many = 20_000  # a live window keeps 6000 rows

    def later(k: int) -> Recorded:
        t_ns = T0_UNIX_NS + k * NS // 10
        payload = encode(msgspec.structs.replace(frame, seq=k, t_unix_ns=t_ns))
        return Recorded(camera_key(SITE, "cam0", "tracks"), t_ns, payload)

    rows = map(later, range(many))
    played = play([*lens_and_fix, *rows], site())
    assert len(played.scene.observations["cam0"]) == many * len(frame.detections)


def test_a_recording_of_nothing_is_an_empty_scene() -> None:
    played = play([])
    assert played == Played(Scene("", (0.0, 0.0, 0.0), (), {}), (), ())


def test_readout_says_what_the_box_says(sent: list[Sent]) -> None:
    """0 is a global shutter, null is not known: the solver gives the one no freedom and the other much."""

    def readout(camera: SiteCamera) -> float | None:
        return camera.readout_s

    change = on_tracks("cam1", lambda t: msgspec.structs.replace(t, readout_s=None))
    played = play(recorded(m for message in sent for m in change(message)), site())
    assert [readout(camera) for camera in played.scene.cameras] == [0.0, None, 0.0, 0.0]
