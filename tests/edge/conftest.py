"""What several tests of the box need."""

from pathlib import Path

import pytest

from tests.edge.detector.onnx_models import dark_dot_model


@pytest.fixture(scope="session")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of the shipped format that finds dark dots."""
    return dark_dot_model(tmp_path_factory.mktemp("model") / "dots.onnx")
