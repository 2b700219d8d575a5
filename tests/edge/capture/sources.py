"""What the tests of the sources share: a time, a size, and a driver that does as it is told."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from edge.capture.frame import Picture
from edge.common.utc import Dated

T0 = 1_700_000_000 * 10**9
MS = 10**6
SIZE = (160, 120)


def undoubted(monotonic_ns: int) -> Dated:
    """A stamp that is UTC already."""
    return Dated(monotonic_ns, 0.0)


def frames_of(source: Any) -> list[Picture]:
    """All that a source gives."""
    return list(iter(source.read, None))


def encode(path: Path, images: list[np.ndarray], options: list[str], form: str = "gray") -> Path:
    """A video of grey images at 25 Hz, as ffmpeg makes it with some options. form: of the images, in its words."""
    height, width = images[0].shape
    head = ["-f", "rawvideo", "-pix_fmt", form, "-s", f"{width}x{height}", "-r", "25", "-i", "-"]
    data = b"".join(image.tobytes() for image in images)
    subprocess.run(["ffmpeg", "-y", "-loglevel", "error", *head, *options, str(path)], input=data, check=True)
    return path


class FakeCapture:
    """Stands in for a driver: frames with the stamps a test wants, then silence."""

    def __init__(self, frames: list[dict[int, float]]) -> None:
        self.frames, self.at, self.released = frames, -1, False

    def isOpened(self) -> bool:
        return True

    def grab(self) -> bool:
        self.at += 1
        return self.at < len(self.frames)

    def retrieve(self) -> tuple[bool, Any]:
        return True, np.zeros((120, 160, 3), np.uint8)

    def get(self, prop: int) -> float:
        return self.frames[self.at].get(prop, 0.0)

    def set(self, prop: int, value: float) -> bool:
        return True

    def release(self) -> None:
        self.released = True
