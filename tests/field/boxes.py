"""A camera box with a video that never ends, for tests that only need one that lives."""

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tests.edge.detector.onnx_models import dark_dot_model
from tests.edge.footage import flight, sky, write_video

SIZE = (320, 240)
CONFIG = """
site = "test"
[[camera]]
id = "cam1"
source = {{ path = "flight.mp4", realtime = true, loop = true }}
[camera.lens]
model = "radtan"
intrinsics = [300.0, 300.0, 159.5, 119.5]
distortion = [0, 0, 0, 0]
size_px = [320, 240]
[detector]
model = "dots.onnx"
[spool]
folder = "{spool}"
[clock]
source = "assumed"
[link]
connect = ["{endpoint}"]
"""


def prepare(folder: Path, endpoint: str) -> Path:
    """Video, model, configuration and the folder `disk` for its spool; returns the configuration."""
    write_video(folder / "flight.mp4", [sky(SIZE, [at], np.random.default_rng(8)) for at in flight(90)], 30)
    dark_dot_model(folder / "dots.onnx")
    (folder / "disk").mkdir()
    file = folder / "edge.toml"
    text = CONFIG.format(spool=folder / "disk", endpoint=endpoint)
    file.write_text(
        text.replace("flight.mp4", str(folder / "flight.mp4")).replace("dots.onnx", str(folder / "dots.onnx"))
    )
    return file


def start(file: Path, *words: str, environment: Mapping[str, str] | None = None) -> "subprocess.Popen[bytes]":
    """`edge-node run`; words before it: a mount of its own, perhaps. Its log is `box.log` beside the file."""
    command = [*words, sys.executable, "-m", "edge.app", "run", "--config", str(file)]
    with (file.parent / "box.log").open("ab") as log:
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=log, env=environment)
