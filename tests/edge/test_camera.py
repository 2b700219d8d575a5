"""One camera of the box: its threads, how it says how it is, and what ends it."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge.camera import CameraWorker, check_view
from edge.capture.frame import Picture
from edge.common.errors import SourceError
from edge.config import load_box
from edge.messages import Tracks
from edge.pictures.view import MOVING_LOOKS, Shift, ViewWatch
from tests.conftest import Until
from tests.edge.capture.sources import undoubted
from tests.edge.detector.onnx_models import constant_model
from tests.edge.footage import flight, sky, write_video

SIZE = (320, 240)
FRAMES = 45
CONFIG = """
site = "test"
[[camera]]
id = "cam1"
source = {{ path = "{video}", {source} }}
lens = {{ model = "radtan", intrinsics = [300, 300, 159.5, 119.5], distortion = [0, 0, 0, 0], size_px = [320, 240] }}
{camera}
[detector]
model = "{model}"
"""


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight of a second and a half."""
    rng = np.random.default_rng(8)
    file = tmp_path_factory.mktemp("box") / "flight.mp4"
    return write_video(file, [sky(SIZE, [place], rng) for place in flight(FRAMES)], 30)


def worker_of(
    folder: Path, video: Path | str, model: Path, source: str = "t0_unix_ns = 1700000000000000000", camera: str = ""
) -> tuple[CameraWorker, list[Tracks]]:
    """The worker of a configuration's one camera, and where it publishes to."""
    file = folder / "edge.toml"
    file.write_text(CONFIG.format(video=video, source=source, camera=camera, model=model))
    box, published = load_box(file), []
    worker = CameraWorker(
        box, box.camera[0], file, epoch=1, clock_bound_s=lambda: 0.001, date=undoubted, publish=published.append
    )
    return worker, published


def levels(worker: CameraWorker) -> dict[str, str]:
    return {check.name: check.level for check in worker.checks()}


def test_a_recording_from_beginning_to_end(tmp_path: Path, video: Path, model: Path, until: Until) -> None:
    worker, published = worker_of(tmp_path, video, model, camera="cores = [0]")
    assert worker.glance() is None
    assert worker.checks()[0].reason == "waiting for the first frame"
    worker.start()
    assert until(lambda: worker.ended, 60)
    assert not worker.failed
    counts = worker.counters()
    assert (counts["frames"], counts["frames_dropped"]) == (FRAMES, 0)
    assert counts["messages"] == len(published)
    assert any(message.detections for message in published)
    frame, _, level, line = worker.glance() or pytest.fail("nothing to see")
    assert frame.size_px == SIZE
    assert (level, line) == ("warn", f"cam1: the recording ended after {FRAMES} frames")
    assert levels(worker)["detector cam1"] == "ok"
    worker.close()


def test_several_frames_side_by_side_come_out_in_order(tmp_path: Path, video: Path, until: Until) -> None:
    boxes = np.zeros((1, 5, 2100), np.float32)
    boxes[0, :, 7] = (160, 160, 10, 10, 0.9)
    path = constant_model(tmp_path / "m.onnx", {"output0": boxes}, input_shape=(1, 3, 320, 320))
    worker, published = worker_of(tmp_path, video, path)
    worker.start()
    assert until(lambda: worker.ended, 60)
    assert not worker.failed
    assert worker.counters()["detector_frames"] == FRAMES
    times = [message.t_unix_ns for message in published if not message.late]
    assert times == sorted(times)
    worker.close()


def test_what_cannot_be_read_ends_it_and_is_said(tmp_path: Path, model: Path, until: Until) -> None:
    (tmp_path / "bad.mp4").write_bytes(b"nonsense" * 50)
    worker, _ = worker_of(tmp_path, tmp_path / "bad.mp4", model)
    worker.start()
    assert until(lambda: worker.ended, 20)
    assert worker.failed
    assert isinstance(worker.error, SourceError)
    check = worker.checks()[0]
    assert (check.name, check.level) == ("camera cam1", "fail")
    assert check.action


def test_a_camera_that_is_not_there_is_tried_again_until_told_to_stop(
    tmp_path: Path, model: Path, until: Until
) -> None:
    worker, _ = worker_of(tmp_path, "rtsp://127.0.0.1:9/none", model, source="timeout_s = 0.5")
    worker.start()
    assert until(lambda: worker.reader.state.reopened > 0, 30)
    assert not worker.ended
    assert levels(worker)["camera cam1"] == "fail"
    began_s = time.monotonic()
    worker.ask_to_stop()
    worker.join(10.0)
    assert worker.ended
    assert time.monotonic() - began_s < 10.0
    assert not worker.failed


@pytest.mark.parametrize(
    ("shifts", "level", "words"),
    [(0, "ok", "stands still"), (1, "warn", "moved by 7 px"), (MOVING_LOOKS, "fail", "again and again")],
)
def test_a_camera_that_moves_is_said(shifts: int, level: str, words: str) -> None:
    view: Any = ViewWatch()
    view.recent.extend(Shift(k, 7.0, -2.0) for k in range(shifts))
    check = check_view("cam1", view)
    assert (check.level, words in check.reason) == (level, True)
    assert bool(check.action) == (level != "ok")


def test_a_live_camera_of_another_size_is_waited_for(tmp_path: Path, model: Path) -> None:
    worker, _ = worker_of(tmp_path, "rtsp://127.0.0.1:9/none", model, source="timeout_s = 0.5")
    other = Picture(10**18, np.zeros((48, 64), np.uint8), "arrival")
    right = Picture(10**18, np.zeros((worker.lens.size_px[1], worker.lens.size_px[0]), np.uint8), "arrival")
    assert not worker._fits(other)
    assert "the frames are 64 x 48" in worker.checks()[0].reason
    assert not worker.failed
    assert worker._fits(right)
    assert "64 x 48" not in worker.checks()[0].reason
