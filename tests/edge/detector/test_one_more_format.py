"""A format of detection models is one record: one more, made here, is recognised, fed, decoded and suppressed."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper

from edge.capture.frame import Picture
from edge.common.errors import ConfigError, ModelError
from edge.common.settings import build
from edge.config import DetectorConfig
from edge.detector.detections import Detections
from edge.detector.formats import MODEL_FORMATS, Candidates, ModelFormat, Outputs, SizePx
from edge.detector.opening import open_detector
from edge.detector.session import Model
from tests.edge.detector.onnx_models import save

BLUE_BGR = (200, 100, 50)


def fits_ssd(model: Model, input_px: SizePx) -> bool:
    """Boxes `[1, N, 4]` and scores `[1, N, classes]`, by these names."""
    return [port.name for port in model.outputs] == ["raw_boxes", "raw_scores"]


def decode_ssd(outputs: Outputs, input_px: SizePx, score_min: float) -> Candidates:
    """Corners top, left, bottom, right as shares of the input."""
    boxes, classes = outputs[0][0].astype(np.float64), outputs[1][0].astype(np.float64)
    keep = classes.max(axis=1) >= score_min
    low, high = boxes[keep, 1::-1] * input_px, boxes[keep, :1:-1] * input_px
    return Candidates((low + high) / 2, high - low, classes[keep].max(axis=1, initial=0.0), classes[keep])


@pytest.fixture(autouse=True, scope="module")
def ssd() -> Iterator[None]:
    """The one line that a new record needs in MODEL_FORMATS."""
    MODEL_FORMATS["ssd"] = ModelFormat("ssd", fits_ssd, decode_ssd, one_column_a_class=True, rgb=False, input_max=255.0)
    yield
    del MODEL_FORMATS["ssd"]


def mean_colour_model(path: Path, names: tuple[str, str]) -> Path:
    """Two boxes over one another whose class scores are the means of the input's channels over 250, the second less."""
    boxes = np.array([[[0.25, 0.5, 0.5, 0.75]] * 2], np.float32)
    shares = np.array([[[1 / 250] * 3, [0.9 / 250] * 3]], np.float32)
    nodes = [
        helper.make_node("ReduceMean", ["images"], ["mean"], axes=[2, 3], keepdims=0),
        helper.make_node("Unsqueeze", ["mean", "one"], ["row"]),
        helper.make_node("Mul", ["row", "shares"], [names[1]]),
        helper.make_node("Identity", ["boxes"], [names[0]]),
    ]
    f = TensorProto.FLOAT
    image = helper.make_tensor_value_info("images", f, (1, 3, 320, 320))
    outputs = [
        helper.make_tensor_value_info(names[0], f, (1, 2, 4)),
        helper.make_tensor_value_info(names[1], f, (1, 2, 3)),
    ]
    constants = {"boxes": boxes, "shares": shares, "one": np.array([1], np.int64)}
    return save(path, nodes, [image], outputs, {}, *(numpy_helper.from_array(v, k) for k, v in constants.items()))


def detect(path: Path, **keys: object) -> Detections:
    config = build({"model": str(path), **keys}, DetectorConfig, where="edge.toml")
    image = np.full((320, 320, 3), BLUE_BGR, np.uint8)
    return open_detector(config, background=False).detect(Picture(10**18, image, "file"), np.zeros((0, 3)))


def test_it_is_chosen_by_name_and_fed_and_read_as_its_record_says(tmp_path: Path) -> None:
    found = detect(mean_colour_model(tmp_path / "m.onnx", ("raw_boxes", "raw_scores")), format="ssd")
    assert len(found) == 1  # one box an object: the record says that the model does not see to it
    assert found.centre_px[0] == pytest.approx([199.5, 119.5], abs=1e-3)
    assert found.size_px[0] == pytest.approx([80.0, 80.0], abs=1e-3)
    # In BGR, and not divided by 255, as the record says; float32 is good to seven digits.
    assert found.classes[0] == pytest.approx(np.array(BLUE_BGR) / 250, abs=1e-4)


def test_where_another_fits_as_well_the_operator_is_asked(tmp_path: Path) -> None:
    path = mean_colour_model(tmp_path / "m.onnx", ("raw_boxes", "raw_scores"))
    with pytest.raises(ModelError, match=r"detr or ssd; set detector\.format to one of .*ssd"):
        detect(path)


def test_a_format_that_there_is_none_of_is_named() -> None:
    with pytest.raises(ConfigError, match=r"key format = 'onnx'.*not one of auto, .*ssd"):
        build({"format": "onnx"}, DetectorConfig, where="edge.toml")


def test_class_names_are_counted(tmp_path: Path) -> None:
    path = mean_colour_model(tmp_path / "m.onnx", ("raw_boxes", "raw_scores"))
    with pytest.raises(ModelError, match="has 3 classes, but 2 class names"):
        detect(path, format="ssd", class_names=["drone", "bird"])
