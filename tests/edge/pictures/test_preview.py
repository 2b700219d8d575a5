"""The preview shows the newest frame with its tracks, in a file and to a browser, and ends when told to."""

import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge.capture.frame import Picture
from edge.common.errors import ConfigError
from edge.gate import TrackRow
from edge.pictures.preview import Preview, draw

FRAME = Picture(10**18, np.full((1080, 1920), 90, np.uint8), "file")
ROWS = [TrackRow(10**18, 3, 959.5, 539.5, 20.0, 10.0, 0.9, "confirmed")]


def latest() -> tuple[Picture, list[TrackRow], str, str]:
    return FRAME, ROWS, "ok", "cam1: frames arrive"


def test_track_is_drawn_where_it_is() -> None:
    picture = cv2.imdecode(np.frombuffer(draw(*latest()), np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (540, 960, 3)
    green = picture[:, :, 1].astype(int) - picture[:, :, 2]
    v, u = np.nonzero(green[:500] > 25)
    assert u.min() == pytest.approx(480 - 8, abs=2)  # the box's left side: half of 10 px, and 3 to see it by
    assert (v.min(), v.max()) == pytest.approx((270 - 8, 270 + 8), abs=3)


def test_file_is_kept_fresh(tmp_path: Path, until) -> None:
    file = tmp_path / "now.jpg"
    with Preview(str(file), latest):
        assert until(file.exists)
    assert cv2.imread(str(file)).shape == (540, 960, 3)


def test_browser_gets_a_stream() -> None:
    with (
        Preview("0", latest) as preview,
        urllib.request.urlopen(f"http://127.0.0.1:{preview.port}/", timeout=5) as page,
    ):
        assert "multipart/x-mixed-replace" in page.headers["Content-Type"]
        data = page.read(4000)
        assert b"\xff\xd8\xff" in data


def test_port_that_is_taken_is_named() -> None:
    with Preview("0", latest) as preview, pytest.raises(ConfigError, match="not free"):
        Preview(str(preview.port), latest)


def test_a_port_that_is_none_is_named() -> None:
    with pytest.raises(ConfigError, match="port 70000 is not free"):
        Preview("70000", latest)
