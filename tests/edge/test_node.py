"""The box as a whole, in this process: started, watched from outside and stopped in order, camera by camera."""

import datetime as dt
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from edge.common.errors import ModelError, SourceError
from edge.config import load_box
from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import Fix, Health, Lens, Tracks, camera_key, decode
from edge.node import Node
from tests.edge.footage import flight, sky, write_video
from tools.doubles.receiver import Place, gga, rmc

SIZE = (320, 240)
T0 = 1_700_000_000 * 10**9
FRAMES = 60
CONFIG = """
site = "test"
[[camera]]
id = "cam1"
source = {{ path = "{folder}/flight.mp4", t0_unix_ns = {t0} }}
lens = {{ model = "radtan", intrinsics = [300, 300, 159.5, 119.5], distortion = [0, 0, 0, 0], size_px = [320, 240] }}
[detector]
model = "{model}"
score_min = 0.3
[clock]
source = "assumed"
[link]
connect = ["{endpoint}"]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight of two seconds."""
    folder = tmp_path_factory.mktemp("box")
    rng = np.random.default_rng(8)
    write_video(folder / "flight.mp4", [sky(SIZE, [place], rng) for place in flight(FRAMES)], 30)
    return folder


def write(folder: Path, model: Path, endpoint: str, extra: str = "", **changes: str) -> Path:
    """A configuration; `changes` of its text."""
    text = CONFIG.format(folder=folder, t0=T0, model=model, endpoint=endpoint) + extra
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    file = folder / f"edge{abs(hash(text))}.toml"
    file.write_text(text)
    return file


@pytest.fixture
def base(endpoint: str) -> Iterator[Link]:
    """The other end of the link."""
    with Link(LinkSettings(listen=(endpoint,)), name="base") as link:
        assert link.wait_open(10)
        yield link


def run(file: Path, stop: threading.Event) -> bool:
    """The box until its recordings have ended; whether all went well."""
    with Node(load_box(file), file, stop) as node:
        return node.run()


def test_a_recording_is_published_to_its_end(folder: Path, model: Path, endpoint: str, base: Link) -> None:
    tracks, health = (base.subscribe(camera_key("test", "cam1", topic)) for topic in ("tracks", "health"))
    lens = base.subscribe(camera_key("test", "cam1", "lens"))
    presence = base.watch_presence(camera_key("test", "*"))
    # At its own pace, so that the link is open before it is over.
    file = write(folder, model, endpoint, **{'flight.mp4",': 'flight.mp4", realtime = true,'})
    with Node(load_box(file), file, threading.Event()) as node:
        assert (present := presence.get(10)) is not None
        assert present.key == camera_key("test", "cam1")
        assert node.run()
        seen = [decode(item.payload, Tracks, where="test") for item in drained(tracks)]
        said = [decode(item.payload, Health, where="test") for item in drained(health)]
        assert decode(drained(lens)[-1].payload, Lens, where="test").intrinsics[0] == 300.0
    flown = [d for message in seen for d in message.detections if d.status == "confirmed"]
    # 2 s at 60 px/s, but a busy machine may be late in opening the link.
    assert len({d.track for d in flown}) == 1
    assert max(d.u_px for d in flown) - min(d.u_px for d in flown) > 40
    assert {message.epoch for message in seen} == {seen[0].epoch}
    (ended,) = [item for item in said[-1].items if item.name == "camera cam1"]
    assert ended.level == "warn"
    assert "the recording ended after" in ended.reason
    assert {"clock", "detector cam1", "view cam1", "focus"} <= {item.name for item in said[-1].items}
    assert said[-1].counters["messages"] >= len(seen)
    assert not any(thread.name.startswith(("camera-", "capture-", "clock", "scan")) for thread in threading.enumerate())


def drained(inbox: object, patience_s: float = 0.5) -> list:
    """What has come and what comes within a moment."""
    got = []
    while (item := inbox.get(patience_s)) is not None:
        got.append(item)
    return got


def test_told_to_stop_it_is_down_within_three_seconds(folder: Path, model: Path, endpoint: str) -> None:
    stop = threading.Event()
    file = write(folder, model, endpoint, **{'flight.mp4",': 'flight.mp4", loop = true, realtime = true,'})
    with Node(load_box(file), file, stop) as node:
        threading.Timer(0.5, stop.set).start()
        assert node.run()
        told_s = time.monotonic()
    assert time.monotonic() - told_s < 3.0


def test_a_camera_that_cannot_be_read_fails_and_the_others_go_on(
    folder: Path, model: Path, endpoint: str, base: Link
) -> None:
    (folder / "broken.mp4").write_bytes(b"nonsense" * 100)
    second = CONFIG[CONFIG.index("[[camera]]") : CONFIG.index("[detector]")].format(folder=folder, t0=T0)
    second = second.replace("cam1", "cam2").replace("flight.mp4", "broken.mp4")
    health = base.subscribe(camera_key("test", "cam2", "health"))
    file = write(folder, model, endpoint, **{"[detector]": f"{second}[detector]"})
    with Node(load_box(file), file, threading.Event()) as node:
        assert not node.run()
        good, bad = node.workers
    assert not good.failed
    assert isinstance(bad.error, SourceError)
    assert good.counters()["frames"] == FRAMES
    item = next(i for i in decode(drained(health)[-1].payload, Health, where="test").items if i.name == "camera cam2")
    assert item.level == "fail"
    assert item.action


def test_a_model_that_does_not_load_is_said_before_anything_starts(folder: Path, model: Path, endpoint: str) -> None:
    file = write(folder, folder / "flight.mp4", endpoint)
    with pytest.raises(ModelError, match="no model that loads"):
        run(file, threading.Event())


def test_a_receiver_and_a_spool_ride_along(
    folder: Path, model: Path, endpoint: str, base: Link, tmp_path: Path
) -> None:
    start, place = dt.datetime(2026, 6, 1, 12, tzinfo=dt.UTC), Place()
    times = [start + dt.timedelta(seconds=second) for second in range(120)]
    (tmp_path / "gnss.nmea").write_bytes(b"".join(gga(t, place) + rmc(t) for t in times))
    extra = f'[gnss]\ndevice = "{tmp_path}/gnss.nmea"\nlever_arm_m = [0, 0, 0]\n[spool]\nfolder = "{tmp_path}"\n'
    stop = threading.Event()
    file = write(folder, model, endpoint, extra, **{'flight.mp4",': 'flight.mp4", loop = true, realtime = true,'})
    fixes, health = (base.subscribe(camera_key("test", "cam1", topic)) for topic in ("fix", "health"))
    with Node(load_box(file), file, stop) as node:
        running = threading.Thread(target=node.run)
        running.start()
        try:
            fix = fixes.get(20)
            assert fix is not None
            # Tenths of millimetres went in; the same every time.
            assert decode(fix.payload, Fix, where="test").lat_deg == pytest.approx(place.lat_deg, abs=1e-8)
            levels = {i.name: i.level for i in decode(health.get(10).payload, Health, where="test").items}
            assert {"gnss", "spool"} <= set(levels)
            assert levels["spool"] == "ok"
            assert (tmp_path / "test-cam1.sqlite").exists()
        finally:
            stop.set()
            running.join(10)
    assert not running.is_alive()
