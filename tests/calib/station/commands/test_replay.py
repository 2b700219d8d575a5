"""A replay is the cameras for all a station can tell: same keys, same stamps, same silence."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from calib.simulation.description import Blind, CameraSpec, ObjectSpec, Simulation
from calib.simulation.simulation import Simulated, simulate
from calib.station.app import main
from calib.station.archive.recording import Recorder
from calib.station.archive.replay_source import Said, open_source
from calib.station.archive.simulated_folder import write_folder
from calib.station.commands import replay as program
from edge.common.errors import SkyfixError
from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import Fix, Lens, Tracks, camera_key, camera_of_key, decode, encode, station_key

NS = 10**9


@pytest.fixture
def simulated() -> Simulated:
    circle = [(40.0 * np.cos(a), 40.0 * np.sin(a), 40.0) for a in np.linspace(0, 2, 6)]
    cameras = [
        CameraSpec(id=f"cam{k}", centre_enu=(0.0, -150.0 - k, 0.0), look_at_enu=(0.0, 0.0, 40.0), frame_rate_hz=10.0)
        for k in range(2)
    ]
    blind = CameraSpec(
        id="cam2",
        centre_enu=(5.0, -150.0, 0.0),
        look_at_enu=(0.0, 0.0, 40.0),
        frame_rate_hz=10.0,
        surveyed=False,
        blind=(Blind(from_s=1.05, to_s=4.45),),
        clutter_per_frame=0.5,
    )
    return simulate(
        Simulation(name="hill", seed=1, object=(ObjectSpec(waypoints_enu=tuple(circle)),), camera=(*cameras, blind))
    )


@pytest.fixture
def folder(tmp_path: Path, simulated: Simulated) -> Path:
    write_folder(simulated, tmp_path / "scene")
    return tmp_path / "scene"


def told(messages: list[Said], camera: str, topic: str) -> list[bytes]:
    return [message.payload for message in messages if (message.camera, message.topic) == (camera, topic)]


def test_a_track_folder_becomes_what_its_boxes_would_have_said(folder: Path, simulated: Simulated) -> None:
    source = open_source(folder)
    assert (source.site, source.cameras) == ("hill", ("cam0", "cam1", "cam2"))
    messages = list(source.messages(epoch=7))
    assert [message.t_ns for message in messages] == sorted(message.t_ns for message in messages)
    frames = [decode(payload, Tracks, where="cam0") for payload in told(messages, "cam0", "tracks")]
    rows = simulated.rows["cam0"]
    assert [frame.t_unix_ns for frame in frames] == rows.t_unix_ns.tolist()
    assert [frame.seq for frame in frames] == list(range(1, len(frames) + 1))
    assert {frame.epoch for frame in frames} == {7}
    pixels = np.array([(d.u_px, d.v_px) for frame in frames for d in frame.detections])
    assert pixels == pytest.approx(rows.pixels, abs=1e-8)
    lens = decode(told(messages, "cam0", "lens")[0], Lens, where="cam0")
    assert lens.intrinsics == simulated.scene.cameras[0].lens.intrinsics
    rays = np.array([(d.ray_x, d.ray_y) for frame in frames for d in frame.detections])
    assert rays * lens.intrinsics[:2] + lens.intrinsics[2:] == pytest.approx(pixels)


def test_only_surveyed_cameras_have_a_fix(folder: Path) -> None:
    messages = list(open_source(folder).messages(epoch=1))
    fix = decode(told(messages, "cam0", "fix")[0], Fix, where="cam0")
    assert fix.sigma_m == pytest.approx((0.02, 0.02, 0.04))
    assert told(messages, "cam2", "fix") == []


def test_all_objects_of_a_frame_are_in_one_message_and_silence_is_told_once_a_second(folder: Path) -> None:
    messages = list(open_source(folder).messages(epoch=1))
    frames = [decode(payload, Tracks, where="cam2") for payload in told(messages, "cam2", "tracks")]
    stamps = [frame.t_unix_ns for frame in frames]
    assert len(set(stamps)) == len(stamps)
    assert max(len(frame.detections) for frame in frames) > 1
    silent = [frame.t_unix_ns for frame in frames if not frame.detections]
    assert [round((t - stamps[0]) * 1e-9, 3) for t in silent] == [2.0, 3.0, 4.0]
    assert max(np.diff(stamps)) <= NS


def test_a_recording_is_said_again_byte_by_byte(tmp_path: Path, folder: Path) -> None:
    original = list(open_source(folder).messages(epoch=3))
    recorder = Recorder(tmp_path / "recordings", "hill", min_free_mb=1)
    for message in original:
        recorder.write(camera_key("hill", message.camera, message.topic), message.payload, message.t_ns)
    recorder.write(station_key("hill", "targets"), b"{}", original[-1].t_ns)
    recorder.close()
    (path,) = (tmp_path / "recordings").glob("*.mcap")
    source = open_source(path)
    assert (source.site, source.cameras) == ("hill", ("cam0", "cam1", "cam2"))
    assert list(source.messages(epoch=9)) == original


def test_over_real_zenoh_a_station_sees_cameras(
    folder: Path, endpoint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with Link(LinkSettings(listen=(endpoint,)), name="station") as station:
        tracks = station.subscribe(camera_key("field", "*", "tracks"), 4096)
        lenses = station.watch_state(camera_key("field", "*", "lens"))
        tokens = station.watch_presence(camera_key("field", "*"))
        assert station.wait_open(5.0)
        station.declare_presence(station_key("field"))
        arguments = [str(folder), "--connect", endpoint, "--speed", "5", "--site", "field"]
        assert main(["replay", *arguments]) == 0
        # What was sent last may still be on its way through Zenoh's threads when its sender has gone.
        said = [message for _ in range(51 + 51 + 20) if (message := tracks.get(5.0)) is not None]
        heard = [decode(message.payload, Tracks, where=message.key) for message in said + tracks.drain()]
        assert len(heard) == 51 + 51 + 20
        assert {camera_of_key(message.key) for message in lenses.drain()} == {"cam0", "cam1", "cam2"}
        assert {camera_of_key(token.key) for token in tokens.drain() if token.alive} == {"cam0", "cam1", "cam2"}
    assert "0 lost" in capsys.readouterr().out


def test_the_pace_is_the_original_times_the_speed(endpoint: str) -> None:
    frame = encode(
        Fix(t_unix_ns=10**18 + 1, lat_deg=0, lon_deg=0, height_m=0, quality=4, sigma_m=(1, 1, 1), frame="", samples=1)
    )
    messages = [Said(10**18 + k * NS // 2, "cam0", "health", frame) for k in range(5)]
    with Link(LinkSettings(listen=(endpoint,)), name="nobody") as link:
        began = time.monotonic()
        said, behind_s = program.play(link, "hill", messages, 4.0, threading.Event())
        took_s = time.monotonic() - began
    assert said["cam0 health"] == 5
    assert 0.45 < took_s < 2.0 + behind_s


def test_nobody_to_play_to_is_said(folder: Path, endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(folder), "--connect", endpoint, "--wait", "0.3"]) == 1
    assert "no station of site 'hill'" in capsys.readouterr().err


def test_what_is_no_source_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("nothing to play here")
    for path in (tmp_path, tmp_path / "notes.txt", tmp_path / "none.mcap"):
        assert main(["replay", str(path), "--wait", "0"]) in (1, 2)  # no such recording, no such folder
        assert str(path) in capsys.readouterr().err


def test_an_empty_scene_is_an_error(folder: Path) -> None:
    for file in (folder / "tracks").iterdir():
        file.write_text("t_unix_ns,u_px,v_px\n")
    with pytest.raises(SkyfixError, match="no row"):
        list(open_source(folder).messages(epoch=1))
