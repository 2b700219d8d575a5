"""What a path means, and what is known of the time of what lies there."""

import threading
from pathlib import Path
from typing import Any

import pytest

from edge.capture import kind_of, open_source
from edge.common.errors import ConfigError
from edge.config import CameraConfig, LensConfig, SourceConfig
from tests.edge.capture.sources import SIZE, undoubted

LENS = LensConfig(model="radtan", intrinsics=(100.0, 100.0, 80.0, 60.0), distortion=(0.0, 0.0, 0.0, 0.0), size_px=SIZE)


def camera(path: str, **source: Any) -> CameraConfig:
    return CameraConfig(id="cam1", lens=LENS, source=SourceConfig(path=path, **source))


def test_kinds_are_told_apart(tmp_path: Path) -> None:
    kinds = {path: kind_of(camera(path)) for path in ("rtsp://box/1", "/dev/video0", "a.mp4", str(tmp_path))}
    assert list(kinds.values()) == ["rtsp", "v4l2", "file", "folder"]
    with pytest.raises(ConfigError, match="no known kind"):
        kind_of(camera("http://box/1"))


def test_undated_recording_has_no_bound(video: Path) -> None:
    source = open_source(camera(str(video)), colour=False, stop=threading.Event(), date=undoubted)
    assert source.read().bound_s is None
