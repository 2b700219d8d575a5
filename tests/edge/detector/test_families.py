"""Models of every family, laid out as their exporters do, are recognised by a run, or refused by name."""

from pathlib import Path

import numpy as np
import onnx
import pytest

from edge.common.errors import ModelError
from edge.config import DetectorConfig
from edge.detector.formats import Candidates
from edge.detector.opening import open_detector
from edge.detector.trial import contradiction
from tests.edge.detector.onnx_models import constant_model
from tests.edge.detector.test_formats import CENTRE_PX, SIZE_PX, detect, in_input

Outputs = dict[str, np.ndarray]
PX = 640


def names(count: int) -> dict[str, str]:
    return {"names": str({k: f"class{k}" for k in range(count)})}


def anchors(rng: np.random.Generator, rows: int, classes: int, *, objectness: bool) -> np.ndarray:
    """Rows of centre, size, objectness, classes: weak ones all over, four sure ones on the object."""
    centre, size = in_input()
    out = np.zeros((1, rows, 5 + classes), np.float32)
    out[0, :, :2], out[0, :, 2:4] = rng.uniform(0, PX, (rows, 2)), rng.uniform(8, 60, (rows, 2))
    out[0, :, 4] = rng.uniform(0, 0.02, rows) if objectness else 1.0
    out[0, :, 5:] = 0.97 if objectness else rng.uniform(0, 0.02, (rows, classes))
    for k, row in enumerate(rng.choice(rows, 4, replace=False)):
        scores = [0.98 if objectness else 0.8 - 0.01 * k, *[0.01] * (classes - 1)]
        out[0, row] = (*(centre + rng.normal(0, 0.2, 2)), *size, 0.82 - 0.01 * k if objectness else 1.0, *scores)
    return out


def yolov5(rng: np.random.Generator, classes: int) -> Outputs:
    return {"output0": anchors(rng, int(rng.choice([25200, 6300, 12096, 25500, 6000])), classes, objectness=True)}


def yolov6(rng: np.random.Generator, classes: int) -> Outputs:
    return {"outputs": anchors(rng, 8400, classes, objectness=False)}


def yolox_decoded(rng: np.random.Generator, classes: int) -> Outputs:
    return {"output": anchors(rng, 8400, classes, objectness=True)}


def rtdetr(rng: np.random.Generator, classes: int) -> Outputs:
    centre, size = in_input()
    out = np.full((1, 300, 4 + classes), 0.02, np.float32)
    out[0, :, :4] = rng.uniform(0.1, 0.9, (300, 4))
    out[0, 5] = (*(centre / PX), *(size / PX), 0.8, *[0.02] * (classes - 1))
    return {"output0": out}


def yolo_nas(rng: np.random.Generator, classes: int) -> Outputs:
    centre, size = in_input()
    middle = rng.uniform(20, PX - 20, (8400, 2))
    boxes = np.concatenate([middle - 10, middle + 10], 1).astype(np.float32)[None]
    scores = rng.uniform(0, 0.03, (1, 8400, classes)).astype(np.float32)
    boxes[0, 77], scores[0, 77, 0] = (*(centre - size / 2), *(centre + size / 2)), 0.8
    return {"boxes": boxes, "scores": scores}


def end_to_end(rng: np.random.Generator, classes: int) -> Outputs:
    centre, size = in_input()
    out = np.zeros((1, 300, 6), np.float32)
    low = rng.uniform(0, 500, (40, 2))
    out[0, 1:41] = np.column_stack(
        [low, low + rng.uniform(5, 90, (40, 2)), rng.uniform(0, 0.2, 40), rng.integers(0, classes, 40)]
    )
    out[0, 0] = (*(centre - size / 2), *(centre + size / 2), 0.8, 0)
    return {"output0": out}


FAMILIES = (yolov5, yolov6, yolox_decoded, rtdetr, yolo_nas, end_to_end)


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", range(4))
def test_a_family_is_recognised_and_its_object_found(tmp_path: Path, family, seed: int, named: bool) -> None:
    rng = np.random.default_rng(seed)
    classes = (1, 2, 3, 80)[seed]
    path = constant_model(tmp_path / "m.onnx", family(rng, classes), notes=names(classes) if named else {})
    detector = open_detector(DetectorConfig(model=str(path)), background=False)
    assert detector._format.name == family.__name__
    found = detect(path)
    assert len(found) == 1
    assert found.centre_px[0] == pytest.approx(CENTRE_PX, abs=1.5)
    assert found.size_px[0] == pytest.approx(SIZE_PX, rel=0.01)
    assert (found.size_px > 0).all()


@pytest.mark.parametrize("task", ["segment", "pose", "obb", "classify"])
def test_a_model_for_another_task_is_named(tmp_path: Path, task: str) -> None:
    out = np.zeros((1, 6, 8400), np.float32)
    path = constant_model(tmp_path / "m.onnx", {"o": out}, notes={"task": task})
    with pytest.raises(ModelError, match=f"for {task}, not for detection"):
        detect(path)


def test_a_format_that_a_run_contradicts_is_refused_even_if_named(tmp_path: Path) -> None:
    path = constant_model(tmp_path / "m.onnx", yolov5(np.random.default_rng(0), 1), notes=names(1))
    with pytest.raises(ModelError, match="as end_to_end it gives classes"):
        detect(path, format="end_to_end")


@pytest.mark.parametrize("note", ["None", "1", "null"])
def test_notes_without_names_are_none(tmp_path: Path, note: str) -> None:
    out = np.zeros((1, 5, 8400), np.float32)
    assert len(detect(constant_model(tmp_path / "m.onnx", {"o": out}, notes={"names": note}))) == 0


@pytest.mark.parametrize("note", ["nil", "[1, 2", "{'a': 1, 2: 'b'}"])
def test_garbled_names_are_named(tmp_path: Path, note: str) -> None:
    out = np.zeros((1, 5, 8400), np.float32)
    with pytest.raises(ModelError, match=r"class names.*detector\.class_names"):
        detect(constant_model(tmp_path / "m.onnx", {"o": out}, notes={"names": note}))
    assert len(detect(tmp_path / "m.onnx", class_names=("a",))) == 0  # what the advice says helps


def four_classes(family, rng: np.random.Generator) -> Outputs:
    """Boxes and scores of four columns each, the scores first."""
    if family == "yolo_nas":
        return dict(reversed(yolo_nas(rng, 4).items()))
    centre, size = in_input()
    boxes = rng.uniform(0.05, 0.95, (1, 300, 4)).astype(np.float32)
    logits = rng.normal(-1.2, 0.4, (1, 300, 4)).astype(np.float32)  # a few above 0, none beyond two in size
    boxes[0, 9], logits[0, :, 0] = (*(centre / PX), *(size / PX)), -1.9
    logits[0, 9, 0] = 1.9
    return {"pred_logits": logits, "pred_boxes": boxes}


@pytest.mark.parametrize("family", ["yolo_nas", "detr"])
@pytest.mark.parametrize("seed", range(182, 187))
def test_boxes_are_told_from_the_scores_of_four_classes(tmp_path: Path, family: str, seed: int) -> None:
    path = constant_model(tmp_path / "m.onnx", four_classes(family, np.random.default_rng(seed)))
    detector = open_detector(DetectorConfig(model=str(path)), background=False)
    assert detector._format.name == family
    found = detect(path)
    best = int(np.argmax(found.score))
    assert found.centre_px[best] == pytest.approx(CENTRE_PX, abs=0.1)
    assert found.size_px[best] == pytest.approx(SIZE_PX, rel=0.01)


@pytest.mark.parametrize("classes", [1, 2, 4, 80])
@pytest.mark.parametrize("named", [True, False])
def test_rows_of_yolov8_are_refused(tmp_path: Path, classes: int, named: bool) -> None:
    """Turned on their side they look like YOLOX's rows, of which the objectness would be the first class."""
    rng = np.random.default_rng(classes)
    out = np.concatenate(
        [rng.uniform(0, PX, (8400, 2)), rng.uniform(8, 60, (8400, 2)), rng.uniform(0, 0.02, (8400, classes))], axis=1
    )
    notes = names(classes) if named else {}
    path = constant_model(tmp_path / "m.onnx", {"output0": out[None].astype(np.float32)}, notes=notes)
    with pytest.raises(ModelError, match="which are no known format; export it as one of"):
        detect(path)


@pytest.mark.parametrize("family", [yolov5, yolov6, yolox_decoded])
def test_many_rows_of_the_one_dot_are_no_picture_full_of_objects(tmp_path: Path, family) -> None:
    outputs = family(np.random.default_rng(188), 2)
    table = next(iter(outputs.values()))[0]
    rows = np.random.default_rng(189).choice(len(table), 90, replace=False)
    table[rows, :2] = np.array([0.4, 0.4]) * PX + np.random.default_rng(190).uniform(-16, 16, (90, 2))
    table[rows, 4:6] = 0.9 if family is not yolov6 else (1.0, 0.9)
    path = constant_model(tmp_path / "m.onnx", outputs)
    assert open_detector(DetectorConfig(model=str(path)), background=False)._format.name == family.__name__


def test_a_model_that_gives_the_trial_picture_no_score_is_told_by_its_boxes(tmp_path: Path) -> None:
    outputs = yolox_decoded(np.random.default_rng(191), 3)
    outputs["output"][0, :, 4] = 0.0
    path = constant_model(tmp_path / "m.onnx", outputs)
    assert open_detector(DetectorConfig(model=str(path)), background=False)._format.name == "yolox_decoded"


def test_a_model_for_several_images_at_once_is_named(tmp_path: Path) -> None:
    path = constant_model(tmp_path / "m.onnx", yolov6(np.random.default_rng(0), 1), input_shape=(4, 3, PX, PX))
    with pytest.raises(ModelError, match="takes 4 images at once; export it again for one image"):
        detect(path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "empty"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12345\n", "git lfs pull"),
        (b"PK\x03\x04" + bytes(100), "PyTorch"),
        (b"\x08\x07garbage", "export it again"),
    ],
)
def test_each_cause_of_a_bad_file_has_its_own_remedy(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "m.onnx").write_bytes(content)
    with pytest.raises(ModelError, match=said):
        detect(tmp_path / "m.onnx")


def test_weights_that_lie_in_another_file_and_are_missing(tmp_path: Path) -> None:
    path = constant_model(tmp_path / "a.onnx", yolov6(np.random.default_rng(0), 2))
    model = onnx.load(str(path))
    onnx.save(model, str(tmp_path / "b.onnx"), save_as_external_data=True, location="b.onnx.data", size_threshold=0)
    assert len(detect(tmp_path / "b.onnx")) == 1
    (tmp_path / "b.onnx.data").unlink()
    with pytest.raises(ModelError, match=r"b\.onnx\.data"):
        detect(tmp_path / "b.onnx")


def test_half_a_download(tmp_path: Path) -> None:
    whole = constant_model(tmp_path / "a.onnx", yolov6(np.random.default_rng(0), 2)).read_bytes()
    (tmp_path / "b.onnx").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ModelError, match="fetch it again"):
        detect(tmp_path / "b.onnx")


def test_sums_and_sizes_contradict() -> None:
    rng = np.random.default_rng(1)
    centre, score = rng.uniform(0, PX, (60, 2)), rng.uniform(0, 0.1, 60)
    good = Candidates(centre, np.full((60, 2), 9.0), score, score[:, None])
    assert contradiction(good, (PX, PX)) == ""
    assert "below 0" in contradiction(Candidates(centre, -good.size, score, good.classes), (PX, PX))
    assert "larger" in contradiction(Candidates(centre, good.size * 1e5, score, good.classes), (PX, PX))
    assert "outside" in contradiction(Candidates(centre * 640, good.size, score, good.classes), (PX, PX))
    assert "full of objects" in contradiction(Candidates(centre, good.size, score + 0.6, good.classes), (PX, PX))
    assert "above 1" in contradiction(Candidates(centre, good.size, score + 3, good.classes), (PX, PX))
