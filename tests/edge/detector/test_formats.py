"""Every output format is recognised or refused, and one known box comes back at the frame pixel it was put at."""

from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto

from edge.capture.frame import Picture
from edge.common.errors import ConfigError, ModelError
from edge.config import DetectorConfig
from edge.detector.detections import Detections
from edge.detector.opening import open_detector
from tests.edge.detector.onnx_models import constant_model

CENTRE_PX, SIZE_PX = (960.3, 411.7), (24.0, 12.0)  # of the object, frame pixels counted from the pixel centre
FRAME_PX = (1280, 720)
NAMES = "{0: 'drone', 1: 'bird'}"
GRID = 80 * 80 + 40 * 40 + 20 * 20


def in_input() -> tuple[np.ndarray, np.ndarray]:
    """Centre and size of the object in a 640 x 640 input, from the corner: half size, 140 px of padding above."""
    return (np.array(CENTRE_PX) + 0.5) / 2 + (0, 140), np.array(SIZE_PX) / 2


def yolov8() -> dict[str, np.ndarray]:
    centre, size = in_input()
    out = np.zeros((1, 6, 8400), np.float32)
    out[0, :, 1234] = (*centre, *size, 0.1, 0.8)
    out[0, :, 1235] = (*(centre + 1), *size, 0.1, 0.7)  # a duplicate
    out[0, :, 77] = (300, 300, 10, 10, 0.1, 0.2)  # too weak
    return {"output0": out}


def end_to_end() -> dict[str, np.ndarray]:
    centre, size = in_input()
    out = np.zeros((1, 300, 6), np.float32)
    out[0, 0] = (*(centre - size / 2), *(centre + size / 2), 0.8, 1)
    return {"output0": out}


def yolox() -> dict[str, np.ndarray]:
    centre, size = in_input()
    out = np.full((1, GRID, 7), -20.0, np.float32)
    out[0, :, 4:] = 0
    cell = (centre // 8).astype(int)
    out[0, cell[1] * 80 + cell[0]] = (*(centre / 8 - cell), *np.log(size / 8), 1.0, 0.1, 0.8)
    return {"output": out}


def detr() -> dict[str, np.ndarray]:
    centre, size = in_input()
    boxes = np.full((1, 300, 4), 0.5, np.float32)
    logits = np.full((1, 300, 2), -9.0, np.float32)
    boxes[0, 7] = (*(centre / 640), *(size / 640))
    logits[0, 7, 1] = np.log(0.8 / 0.2)
    return {"dets": boxes, "labels": logits}


def labels_boxes_scores() -> dict[str, np.ndarray]:
    centre, size = in_input()
    boxes, scores = np.zeros((1, 300, 4), np.float32), np.zeros((1, 300), np.float32)
    boxes[0, 3] = (*(centre - size / 2), *(centre + size / 2))
    scores[0, 3] = 0.8
    return {"labels": np.full((1, 300), 1, np.int64), "boxes": boxes, "scores": scores}


FORMATS = [yolov8, end_to_end, yolox, detr, labels_boxes_scores]


def detect(path: Path, **config: object) -> Detections:
    detector = open_detector(DetectorConfig(model=str(path), **config), background=False)
    image = np.zeros((FRAME_PX[1], FRAME_PX[0], 3), np.uint8)
    return detector.detect(Picture(10**18, image, "file"), np.zeros((0, 3)))


@pytest.mark.parametrize("outputs", FORMATS)
def test_known_box_comes_back(tmp_path: Path, outputs) -> None:
    found = detect(constant_model(tmp_path / "m.onnx", outputs(), notes={"names": NAMES}))
    assert len(found) == 1
    assert found.centre_px[0] == pytest.approx(CENTRE_PX, abs=1e-3)
    assert found.size_px[0] == pytest.approx(SIZE_PX, rel=1e-4)
    assert found.score[0] == pytest.approx(0.8, abs=1e-4)
    assert np.argmax(found.classes[0]) == 1
    assert np.isnan(found.sigma_px[0])


@pytest.mark.parametrize(
    ("shape", "kind"),
    [
        ((1, 3, 640, 640), TensorProto.FLOAT16),
        ((1, 640, 640, 3), TensorProto.UINT8),
        ((1, 1, 640, 640), TensorProto.FLOAT),
    ],
)
def test_input_layouts_and_types(tmp_path: Path, shape: tuple[int, ...], kind: int) -> None:
    path = constant_model(tmp_path / "m.onnx", yolov8(), input_shape=shape, input_type=kind)
    detector = open_detector(DetectorConfig(model=str(path)), background=False)
    image = np.zeros((720, 1280, 3) if detector.colour else (720, 1280), np.uint8)
    assert len(detector.detect(Picture(10**18, image, "file"), np.zeros((0, 3)))) == 1


@pytest.mark.parametrize(
    ("outputs", "notes"),
    [
        ({"o": np.zeros((1, GRID, 6), np.float32)}, {}),  # end to end, or a one-class YOLOX
        ({"o": np.zeros((1, 6, 8400), np.float32)}, {"names": "{0: 'a', 1: 'b', 2: 'c'}"}),  # 2 classes, 3 names
        ({"o": np.zeros((1, 4, 8400), np.float32)}, {}),
        ({"a": np.zeros((1, 3), np.float32), "b": np.zeros((1, 3), np.float32)}, {}),
    ],
)
def test_ambiguous_shapes_are_refused_with_a_way_out(tmp_path: Path, outputs, notes) -> None:
    with pytest.raises(ModelError, match=r"m\.onnx.*detector\.format"):
        detect(constant_model(tmp_path / "m.onnx", outputs, notes=notes))


def test_ambiguous_shape_is_read_as_told(tmp_path: Path) -> None:
    outputs = {"o": np.zeros((1, GRID, 6), np.float32)}
    outputs["o"][0, 0] = (10, 10, 20, 20, 0.9, 0)
    assert len(detect(constant_model(tmp_path / "m.onnx", outputs), format="end_to_end")) == 1


def test_a_format_that_is_not_the_models_is_refused(tmp_path: Path) -> None:
    path = constant_model(tmp_path / "m.onnx", yolov8())
    with pytest.raises(ModelError, match="carries no skyfix note"):
        detect(path, format="skyfix")
    with pytest.raises(ModelError, match="are not labels_boxes_scores"):
        detect(path, format="labels_boxes_scores")


def test_files_that_are_no_model(tmp_path: Path) -> None:
    (tmp_path / "garbage.onnx").write_bytes(b"\x08\x07garbage")
    with pytest.raises(ModelError, match=r"garbage\.onnx.*no model that loads"):
        detect(tmp_path / "garbage.onnx")
    with pytest.raises(ModelError, match="no such model file"):
        detect(tmp_path / "none.onnx")


def test_free_input_size_must_be_said(tmp_path: Path) -> None:
    free = constant_model(tmp_path / "m.onnx", yolov8(), input_shape=(1, 3, "h", "w"))
    with pytest.raises(ModelError, match="input_size_px"):
        detect(free)
    assert len(detect(free, input_size_px=(640, 640))) == 1
    noted = constant_model(tmp_path / "n.onnx", yolov8(), input_shape=(1, 3, "h", "w"), notes={"imgsz": "[640, 640]"})
    assert len(detect(noted)) == 1


def test_wrong_number_of_class_names_is_refused(tmp_path: Path) -> None:
    path = constant_model(tmp_path / "m.onnx", yolov8())
    with pytest.raises(ModelError, match="2 classes, but 3 class names"):
        detect(path, class_names=("a", "b", "c"))


def test_two_stage_needs_our_own_format(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="two_stage needs"):
        detect(constant_model(tmp_path / "m.onnx", yolov8()), mode="two_stage")


def test_nan_and_infinite_boxes_are_left_out(tmp_path: Path) -> None:
    outputs = yolov8()
    outputs["output0"][0, :, 9] = (np.nan, 5, 5, 5, 0.9, 0.9)
    outputs["output0"][0, :, 10] = (5, 5, np.inf, 5, 0.9, 0.9)
    assert len(detect(constant_model(tmp_path / "m.onnx", outputs))) == 1


def test_tiles_find_the_same_object_once(tmp_path: Path) -> None:
    outputs = {"o": np.zeros((1, 300, 6), np.float32)}
    outputs["o"][0, 0] = (310, 310, 330, 330, 0.9, 0)
    found = detect(constant_model(tmp_path / "m.onnx", outputs), tiles=True)
    assert len(found) == 6  # three tiles across, two down, each with its own object in its middle
    assert found.centre_px[:, 0].max() == pytest.approx(1280 - 640 + 319.5)
