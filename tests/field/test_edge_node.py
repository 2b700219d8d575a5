"""Whole edge-node processes: real video files, real Zenoh on loopback, real signals."""

import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import Health, Lens, Tracks, camera_key, decode
from tests.conftest import Until
from tests.edge.detector.onnx_models import constant_model, dark_dot_model
from tests.edge.footage import flight, sky, write_video

SIZE = (320, 240)
T0 = 1_700_000_000 * 10**9
FPS = 30
LENS = 'model = "radtan"\nintrinsics = [300.0, 300.0, 159.5, 119.5]\ndistortion = [0, 0, 0, 0]\nsize_px = [320, 240]\n'

CONFIG = """
site = "test"
[[camera]]
id = "cam1"
lens = "lens.toml"
source = {{ path = "{video}", t0_unix_ns = {t0}, {source} }}
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
    """A flight of three seconds, a lens and a model."""
    folder = tmp_path_factory.mktemp("box")
    rng = np.random.default_rng(8)
    write_video(folder / "flight.mp4", [sky(SIZE, [place], rng) for place in flight(90)], FPS)
    (folder / "lens.toml").write_text(LENS)
    dark_dot_model(folder / "dots.onnx")
    return folder


def config(folder: Path, endpoint: str = "tcp/127.0.0.1:1", source: str = "loop = false", **changes: str) -> Path:
    text = CONFIG.format(
        video=folder / "flight.mp4", t0=T0, source=source, model=folder / "dots.onnx", endpoint=endpoint
    )
    for name, new in changes.items():
        old = {"video": "flight.mp4", "model": "dots.onnx", "lens": '"lens.toml"'}.get(name, name)
        assert old in text
        text = text.replace(old, new)
    file = folder / f"{abs(hash(text))}.toml"
    file.write_text(text)
    return file


def start(*arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "edge.app", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str], within_s: float = 30) -> tuple[int, str, str]:
    try:
        out, err = process.communicate(timeout=within_s)
    finally:
        process.kill()
    assert "Traceback" not in err
    return process.returncode, out, err


@pytest.fixture
def base(endpoint: str) -> Iterator[Link]:
    with Link(LinkSettings(listen=(endpoint,)), name="base") as link:
        assert link.wait_open(5)
        yield link


def test_a_flight_in_real_time_arrives_as_one_track(folder: Path, endpoint: str, base: Link, until) -> None:
    inbox = base.subscribe("skyfix/1/test/**", capacity=2000)
    # Stamps are this moment's: the first frame is played two seconds from now, when the box will be up.
    t0 = time.time_ns() + 3 * 10**9
    source = f"realtime = true, start_at_unix_ns = {t0}"
    file = config(folder, endpoint, source, **{str(T0): str(t0)})
    process = start("run", "--config", file)
    code, _, _ = finish(process)
    assert code == 0

    received = [(one.key.rpartition("/")[2], one.payload) for one in inbox.drain()]
    count = Counter(topic for topic, _ in received)
    assert count["lens"] >= 1
    assert decode(next(p for topic, p in received if topic == "lens"), Lens, where="lens").size_px == SIZE
    health = [decode(payload, Health, where="health") for topic, payload in received if topic == "health"]
    assert health[-1].counters["frames"] + health[-1].counters["frames_dropped"] == 90
    tracks = [decode(payload, Tracks, where="tracks") for topic, payload in received if topic == "tracks"]
    assert [message.seq for message in tracks] == sorted(message.seq for message in tracks)
    seen = {message.t_unix_ns: one for message in tracks for one in message.detections}
    assert len({one.track for one in seen.values()}) == 1
    assert len(seen) >= 45  # of 90; half may be lost where other tests share the machine
    for t, one in seen.items():
        u, v = flight(90)[round((t - t0) * FPS / 1e9)]
        assert (one.u_px, one.v_px) == pytest.approx((u, v), abs=1.6)
        assert one.ray_x == pytest.approx((one.u_px - 159.5) / 300)


def test_recording_gives_the_same_bytes_each_time(folder: Path, endpoint: str, base: Link) -> None:
    runs = []
    for _ in range(2):
        inbox = base.subscribe(camera_key("test", "cam1", "tracks"), capacity=2000)
        code, _, err = finish(start("run", "--config", config(folder, endpoint, "bound_s = 0.001")))
        assert code == 0, err
        tracks = [decode(one.payload, Tracks, where="tracks") for one in inbox.drain()]
        runs.append([(message.t_unix_ns, message.seq, message.detections) for message in tracks])
    # The first messages go before the link has found the base; what arrived must be equal.
    first, second = ({seq: (t, found) for t, seq, found in run} for run in runs)
    common = first.keys() & second.keys()
    assert all(first[seq] == second[seq] for seq in common)


def catches(pid: int, number: int) -> bool:
    """Whether a process has installed a handler of its own for a signal."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = next(line.split()[1] for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught, 16) >> (number - 1) & 1)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_told_to_stop_it_stops_within_three_seconds(folder: Path, number: int, until: Until) -> None:
    process = start("run", "--config", config(folder, source="realtime = true, loop = true"))
    assert until(lambda: catches(process.pid, signal.SIGTERM), within_s=30)
    process.send_signal(number)
    told = time.monotonic()
    code, _, _ = finish(process)
    assert code == 0
    assert time.monotonic() - told < 3.0


def test_one_camera_fails_and_the_other_goes_on(folder: Path, endpoint: str, base: Link) -> None:
    file = config(folder, endpoint)
    head, rest = file.read_text().split("[detector]")
    second = head.split("[[camera]]")[1].replace("cam1", "cam2").replace("flight.mp4", "none.mp4")
    file = folder / "two.toml"
    file.write_text(f"{head}[[camera]]{second}[detector]{rest}")
    inbox = base.subscribe(camera_key("test", "*", "tracks"), capacity=2000)
    code, _, err = finish(start("run", "--config", file))
    assert code == 1
    assert "none.mp4: no such file" in err
    assert {one.key.split("/")[4] for one in inbox.drain()} == {"cam1"}


@pytest.mark.parametrize(
    ("changes", "code", "said"),
    [
        ({"video": "none.mp4"}, 1, "none.mp4: no such file"),
        ({"video": "lens.toml"}, 1, "no video that can be opened"),
        ({"model": "lens.toml"}, 1, "no model that loads"),
        ({"model": "none.onnx"}, 1, "no such model file"),
        ({"lens": '"none.toml"'}, 2, "no such lens file"),
        ({"lens": '"big.toml"'}, 2, "measured at 640 x 480, the frames are 320 x 240"),
        ({"id =": "idd ="}, 2, 'did you mean "id"'),
        (
            {"[detector]": '[[camera]]\nid = "cam1"\nlens = "lens.toml"\nsource.path = "a"\n[detector]'},
            2,
            "named twice",
        ),
    ],
)
def test_bad_input_is_named_with_what_to_do(folder: Path, changes: dict[str, str], code: int, said: str) -> None:
    (folder / "big.toml").write_text(LENS.replace("[320, 240]", "[640, 480]"))
    got, _, err = finish(start("run", "--config", config(folder, **changes)))
    assert said in err
    assert got == code


def test_model_of_the_wrong_shape_is_refused_at_the_start(folder: Path) -> None:
    constant_model(folder / "odd.onnx", {"out": np.zeros((1, 7), np.float32)})
    code, _, err = finish(start("run", "--config", config(folder, model="odd.onnx")))
    assert (code, "no known format" in err) == (1, True)


def test_check_tells_everything(folder: Path, endpoint: str) -> None:
    code, out, _ = finish(start("check", "--config", config(folder, endpoint, "bound_s = 0.001")))
    assert code == 0
    assert '"profile": "tracks"' in out
    for line in ("PASS configuration", "PASS lens cam1", "PASS camera cam1", "PASS detector cam1", "WARN link"):
        assert f"\n{line}" in out


def test_check_fails_with_what_to_do(folder: Path) -> None:
    code, out, _ = finish(start("check", "--config", config(folder, video="none.mp4")))
    assert code == 1
    assert "FAIL camera cam1" in out
    assert "give the path of a video file" in out


def test_check_names_a_lens_that_is_not_measured_yet_beside_all_else(folder: Path, endpoint: str) -> None:
    """A box that was just installed: its template names a lens file that nobody could have made yet."""
    code, out, _ = finish(start("check", "--config", config(folder, endpoint, lens='"none.toml"')))
    assert code == 1
    assert "\nFAIL lens cam1" in out
    assert f"edge-node lens PHOTOS... --board 9x6 -o {folder / 'none.toml'}" in out
    assert "\nWARN link" in out


@pytest.mark.parametrize("arguments", [[], ["fly"], ["run"], ["lens", "a.png"]])
def test_wrong_usage(arguments: list[str]) -> None:
    assert finish(start(*arguments))[0] == 2


def test_help_is_complete() -> None:
    code, out, _ = finish(start("--help"))
    assert code == 0
    assert all(word in out for word in ("run", "check", "lens", "detect", "exit codes"))
