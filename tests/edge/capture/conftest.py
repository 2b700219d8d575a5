"""Footage that several tests of the sources read."""

from pathlib import Path

import numpy as np
import pytest

from tests.edge.capture.sources import SIZE
from tests.edge.footage import sky, write_video


@pytest.fixture(scope="session")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty frames at 25 Hz."""
    rng = np.random.default_rng(3)
    images = [sky(SIZE, [(20.0 + 3 * k, 60.0)], rng) for k in range(20)]
    return write_video(tmp_path_factory.mktemp("video") / "a.mp4", images, fps=25)
