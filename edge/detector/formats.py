"""What the numbers that come out of a detection model mean: one record a format, told apart by shape, or refused.

The hazard is the plausible reading. `[1, 8400, 6]` may be finished boxes or a one-class grid; read the wrong way it
still yields boxes, only wrong ones. So a format is recognised where shapes, names or the author's notes leave one
reading, and refused with a request to name it where they leave several.

A new format is one ModelFormat in MODEL_FORMATS. Each decodes the outputs of one image to corner-origin input pixels;
rows below `score_min` are left out before anything costly is done with them.
"""

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array
from edge.common.errors import ModelError
from edge.common.plugs import check_name, name_among

if TYPE_CHECKING:
    from edge.detector.session import Model  # ONNX Runtime's: whoever only wants the formats' names does without it

Outputs = Sequence[NDArray[Any]]
SizePx = tuple[int, int]

AUTO: Final = "auto"  # in a configuration: the format is recognised
STACK_FORMAT: Final = "skyfix"  # the shipped kind of model, skyfix.py's; and the note that such a model carries
YOLOX_STRIDES: Final = (8, 16, 32)
ANCHORS_A_CELL: Final = 3  # of YOLOv3, v5 and v7
FEWEST_ANCHORS: Final = 1000  # rows: no DETR has so many queries, and no grid of a useful input so few
SHARES_REACH: Final = 2.0  # of a picture that a box may reach to: beyond it, numbers are pixels
# Score of a class, given that there is an object: one of them is more likely, if only at chance.
NOWHERE_LIKELY: Final = 0.05
IMAGENET_MEAN: Final = (0.485, 0.456, 0.406)  # RGB, what DETR backbones were trained with
IMAGENET_STD: Final = (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class Candidates:
    """Boxes of one image, input pixels from the corner. centre, size: `(N, 2)`. score: `(N,)`. classes: `(N, C)`."""

    centre: Array
    size: Array
    score: Array
    classes: Array


@dataclass(frozen=True)
class ModelFormat:
    """A family of detection models.

    fits: whether a model with an input of so many pixels (width, height) can be of it. decode: outputs of one image,
    input size and least score to Candidates. one_column_a_class: whether the outputs say how many classes there are.
    suppressed: whether the model itself keeps one box an object. rgb: the order of its colours, else BGR.
    input_max: what 255 becomes. standardised: whether ImageNet's mean and deviation are taken off. denies: why outputs
    of a trial picture cannot be of it; empty if they can (what every format's boxes obey, trial.py knows). doubts: why
    they may be of a family that is not known here; asked where nobody named the format.
    """

    name: str
    fits: Callable[["Model", SizePx], bool]
    decode: Callable[[Outputs, SizePx, float], Candidates]
    one_column_a_class: bool = False
    suppressed: bool = False
    rgb: bool = True
    input_max: float = 1.0
    standardised: bool = False
    denies: Callable[[Outputs, SizePx], str] = lambda outputs, input_px: ""
    doubts: Callable[[Outputs], str] = lambda outputs: ""


def fitting(model: "Model", input_px: SizePx) -> list[ModelFormat]:
    """The formats that a model's shapes, names and notes allow. Raises ModelError if it is no detection model."""
    task = model.notes.get("task", "detect")
    if task != "detect":
        action = "export a detection model: in Ultralytics one without -seg, -pose, -obb or -cls"
        raise ModelError(f"is a model for {task}, not for detection", where=model.path, action=action)
    return [kind for kind in MODEL_FORMATS.values() if kind.fits(model, input_px)]


def one_of(model: "Model", formats: list[ModelFormat], denied: dict[str, str]) -> ModelFormat:
    """The one format of several. denied: why others are not it. Raises ModelError if there are more, or none."""
    if len(formats) == 1:
        return formats[0]
    shapes = [port.shape for port in model.outputs]
    known = class_names_in(model)
    named = "" if known is None else f" and {known} class names"
    named += "".join(f", as {name} {why}" for name, why in denied.items())
    readings = f"can be read as {' or '.join(kind.name for kind in formats)}" if formats else "are no known format"
    known_ones = ", ".join(MODEL_FORMATS)
    action = (
        f"set detector.format to one of {known_ones}"
        if formats
        else f"export it as one of those that detector.format can name: {known_ones}"
    )
    raise ModelError(f"has outputs of shapes {shapes}{named}, which {readings}", where=model.path, action=action)


def _one_output(model: "Model") -> tuple[int | None, int | None] | None:
    """Rows and columns of the one output `[1, rows, columns]`, None where free; None if that is not what it has."""
    shapes = [port.shape for port in model.outputs]
    return (shapes[0][1], shapes[0][2]) if len(shapes) == 1 and len(shapes[0]) == 3 else None


def _fits_yolov8(model: "Model", input_px: SizePx) -> bool:
    """Boxes lie along the longer side, which is the second."""
    rows, columns = _one_output(model) or (None, None)
    if rows is None or rows < 5 or (columns is not None and columns <= rows):
        return False
    return class_names_in(model) in (None, rows - 4)


def _fits_yolov5(model: "Model", input_px: SizePx) -> bool:
    """Three anchors a cell, whatever the strides: v3, v5, v7, their tiny and their P6 forms."""
    rows, columns = _one_output(model) or (None, None)
    if columns is None or columns < 6 or rows is None or rows < FEWEST_ANCHORS or rows % ANCHORS_A_CELL:
        return False
    return rows != _cells(input_px) and class_names_in(model) in (None, columns - 5)


def _fits_rtdetr(model: "Model", input_px: SizePx) -> bool:
    """A few hundred queries, fewer than any grid has cells."""
    rows, columns = _one_output(model) or (None, None)
    if columns is None or columns < 5 or rows is None or not columns < rows < FEWEST_ANCHORS:
        return False
    return class_names_in(model) in (None, columns - 4)


def _fits_yolox(model: "Model", input_px: SizePx) -> bool:
    rows, columns = _one_output(model) or (None, None)
    return columns is not None and rows == _cells(input_px) and class_names_in(model) in (None, columns - 5)


def _fits_end_to_end(model: "Model", input_px: SizePx) -> bool:
    rows, columns = _one_output(model) or (None, None)
    if columns != 6 or rows is None or rows <= 6:
        return False
    return rows != _cells(input_px) or class_names_in(model) is None


def _rows_of_two(model: "Model") -> int | None:
    """Rows of two outputs, one of them boxes; 0 where they have no fixed number, None for other outputs."""
    shapes = [port.shape for port in model.outputs]
    fit = len(shapes) == 2 and all(len(shape) == 3 for shape in shapes) and any(shape[2] == 4 for shape in shapes)
    return (shapes[0][1] or 0) if fit else None


def _fits_detr(model: "Model", input_px: SizePx) -> bool:
    rows = _rows_of_two(model)
    return rows is not None and rows < FEWEST_ANCHORS


def _fits_yolo_nas(model: "Model", input_px: SizePx) -> bool:
    rows = _rows_of_two(model)
    return rows is not None and not 0 < rows < FEWEST_ANCHORS


def _fits_labels_boxes_scores(model: "Model", input_px: SizePx) -> bool:
    return sorted(len(port.shape) for port in model.outputs) == [2, 2, 3]


def _denies_end_to_end(outputs: Outputs, input_px: SizePx) -> str:
    label = outputs[0][0][:, 5]
    return "" if np.all(np.isfinite(label)) and np.all(label == np.rint(label)) else "classes that are no whole numbers"


def _denies_rtdetr(outputs: Outputs, input_px: SizePx) -> str:
    return "rows of zeros" if np.any(np.all(outputs[0][0] == 0, axis=1)) else ""


def _denies_yolov6(outputs: Outputs, input_px: SizePx) -> str:
    return "" if np.all(outputs[0][0][:, 4] == 1.0) else "an objectness that is not 1"


def _denies_yolox_decoded(outputs: Outputs, input_px: SizePx) -> str:
    return "an objectness of 1 everywhere" if np.all(outputs[0][0][:, 4] == 1.0) else ""


def _doubts_yolox_decoded(outputs: Outputs) -> str:
    """Rows of YOLOv8 without names look the same: their first class is taken for the objectness."""
    return "classes that are nowhere likely" if float(outputs[0][0][:, 5:].max(initial=0.0)) < NOWHERE_LIKELY else ""


def _denies_detr(outputs: Outputs, input_px: SizePx) -> str:
    boxes, _ = _boxes_and_classes(outputs, shares=True)
    return "boxes far beyond shares of the picture" if float(np.abs(boxes).max(initial=0.0)) > SHARES_REACH else ""


def _denies_yolo_nas(outputs: Outputs, input_px: SizePx) -> str:
    boxes, scores = _boxes_and_classes(outputs, shares=False)
    if float(np.abs(boxes).max(initial=0.0)) <= SHARES_REACH:
        return "all boxes within one pixel"
    return "" if float(scores.min(initial=0.0)) >= 0 and float(scores.max(initial=0.0)) <= 1 else "scores beyond 0 to 1"


def _cells(input_px: SizePx) -> int:
    """How many boxes a grid of YOLOX's strides has."""
    return sum((input_px[0] // stride) * (input_px[1] // stride) for stride in YOLOX_STRIDES)


def class_names_in(model: "Model") -> int | None:
    """How many class names the model carries; None if it carries none."""
    names = read_class_names(model)
    return len(names) if names else None


def _boxes_and_classes(outputs: Outputs, *, shares: bool) -> tuple[NDArray[Any], NDArray[Any]]:
    """Which of two outputs holds the boxes: that of four columns. shares: whether they are shares of the picture.

    With four classes both have four: then shares lie within 0 and 1, and pixels reach further than scores.
    """
    one, other = outputs
    if one.shape[2] != 4 or other.shape[2] != 4:
        return (one, other) if one.shape[2] == 4 else (other, one)
    within = [bool(np.all((value >= 0) & (value <= 1))) for value in outputs]
    swapped = within == [False, True] if shares else within == [True, False]
    return (other, one) if swapped else (one, other)


def read_class_names(model: "Model") -> tuple[str, ...]:
    """The class names that the model's author wrote into it, as Ultralytics does; empty if there are none."""
    note = model.notes.get("names", "()")
    try:
        names = None if note == "null" else ast.literal_eval(note)
    except (ValueError, SyntaxError) as error:
        action = "set detector.class_names"
        raise ModelError(f"its note of class names is garbled ({error})", where=model.path, action=action) from error
    if names is None or isinstance(names, int | float):
        return ()  # exporters that knew no names wrote None, or how many there are
    if isinstance(names, str):
        return (names,)
    try:
        return tuple(str(names[key]) for key in sorted(names)) if isinstance(names, dict) else tuple(map(str, names))
    except TypeError as error:
        action = "set detector.class_names"
        raise ModelError(f"its note of class names is garbled ({error})", where=model.path, action=action) from error


def garbled_names(model: "Model") -> bool:
    """Whether a model's note of its class names cannot be read."""
    try:
        read_class_names(model)
    except ModelError:
        return True
    return False


def decode_yolov8(outputs: Outputs, input_px: SizePx, score_min: float) -> Candidates:
    """`[1, 4 + nc, N]`: centre and size in input pixels, scores already between 0 and 1 (Ultralytics v8, 11)."""
    table = outputs[0][0]
    score = table[4:].max(axis=0)
    table = table[:, score >= score_min].astype(np.float64)
    return Candidates(table[:2].T, table[2:4].T, table[4:].max(axis=0, initial=0.0), table[4:].T)


def decode_end_to_end(outputs: Outputs, input_px: SizePx, score_min: float) -> Candidates:
    """`[1, N, 6]`: two corners, score, class; already suppressed (YOLOv10 and Ultralytics' end-to-end heads)."""
    table = outputs[0][0].astype(np.float64)
    table = table[table[:, 4] >= score_min]
    return _from_corners(table[:, :4], table[:, 4], _whole(table[:, 5]))


def decode_yolov5(outputs: Outputs, input_px: SizePx, score_min: float) -> Candidates:
    """`[1, N, 5 + nc]`: centre and size in input pixels, objectness, class scores (YOLOv3, v5, v6, v7)."""
    table = outputs[0][0]
    score = table[:, 4] * table[:, 5:].max(axis=1)
    table = table[score >= score_min].astype(np.float64)
    classes = table[:, 4:5] * table[:, 5:]
    return Candidates(table[:, :2], table[:, 2:4], classes.max(axis=1, initial=0.0), classes)


def decode_rtdetr(outputs: Outputs, input_px: SizePx, score_min: float) -> Candidates:
    """`[1, N, 4 + nc]`: centre and size as shares of the input, class scores (RT-DETR as Ultralytics exports it)."""
    table = outputs[0][0]
    table = table[table[:, 4:].max(axis=1) >= score_min].astype(np.float64)
    boxes = table[:, :4] * (*input_px, *input_px)
    return Candidates(boxes[:, :2], boxes[:, 2:], table[:, 4:].max(axis=1, initial=0.0), table[:, 4:])


def decode_yolo_nas(outputs: Outputs, input_px: SizePx, score_min: float) -> Candidates:
    """Corners `[1, N, 4]` in input pixels and class scores `[1, N, nc]` (YOLO-NAS)."""
    boxes, classes = _boxes_and_classes(outputs, shares=False)
    score = classes[0].max(axis=1)
    keep = score >= score_min
    corners, chosen = boxes[0][keep].astype(np.float64), classes[0][keep].astype(np.float64)
    low, high = corners[:, :2], corners[:, 2:]
    return Candidates((low + high) / 2, high - low, score[keep].astype(np.float64), chosen)


def decode_yolox(outputs: Outputs, input_px: SizePx, score_min: float) -> Candidates:
    """`[1, N, 5 + nc]`: offsets in cells, log sizes in strides, objectness, class scores (Ge et al. 2021)."""
    table = outputs[0][0]
    score = table[:, 4] * table[:, 5:].max(axis=1)
    keep = score >= score_min
    cell, stride = _yolox_grid(input_px)
    table, cell, stride = table[keep].astype(np.float64), cell[keep], stride[keep]
    classes = table[:, 4:5] * table[:, 5:]
    return Candidates(
        (table[:, :2] + cell) * stride, np.exp(table[:, 2:4]) * stride, score[keep].astype(np.float64), classes
    )


def _yolox_grid(input_px: SizePx) -> tuple[Array, Array]:
    cells, strides = [], []
    for stride in YOLOX_STRIDES:
        across, down = np.meshgrid(np.arange(input_px[0] // stride), np.arange(input_px[1] // stride))
        cells.append(np.stack([across.ravel(), down.ravel()], axis=1))
        strides.append(np.full((across.size, 1), float(stride)))
    return np.concatenate(cells).astype(np.float64), np.concatenate(strides)


def decode_detr(outputs: Outputs, input_px: SizePx, score_min: float) -> Candidates:
    """Boxes `[1, N, 4]`, centre and size as shares of the input, and logits `[1, N, nc]` (RF-DETR)."""
    boxes, logits = _boxes_and_classes(outputs, shares=True)
    classes = 1.0 / (1.0 + np.exp(-logits[0].astype(np.float64)))
    score = classes.max(axis=1)
    keep = score >= score_min
    boxes = boxes[0][keep].astype(np.float64) * (*input_px, *input_px)
    return Candidates(boxes[:, :2], boxes[:, 2:], score[keep], classes[keep])


def decode_labels_boxes_scores(outputs: Outputs, input_px: SizePx, score_min: float) -> Candidates:
    """Labels `[1, N]`, corners `[1, N, 4]` in input pixels, scores `[1, N]` (RT-DETR and D-FINE as deployed)."""
    boxes = next(value for value in outputs if value.ndim == 3)[0].astype(np.float64)
    flat = [value for value in outputs if value.ndim == 2]
    whole = [np.issubdtype(value.dtype, np.integer) for value in flat]
    labels, scores = (flat[0], flat[1]) if whole[0] or not whole[1] else (flat[1], flat[0])
    score = scores[0].astype(np.float64)
    keep = score >= score_min
    return _from_corners(boxes[keep], score[keep], _whole(labels[0][keep]))


def _whole(labels: NDArray[Any]) -> NDArray[np.intp]:
    index: NDArray[np.intp] = np.maximum(np.rint(labels), 0).astype(np.intp)
    return index


def _from_corners(corners: Array, score: Array, label: NDArray[np.intp]) -> Candidates:
    low, high = corners[:, :2], corners[:, 2:]
    classes = np.zeros((len(label), int(label.max(initial=0)) + 1))
    classes[np.arange(len(label)), label] = score
    return Candidates((low + high) / 2, high - low, score, classes)


MODEL_FORMATS: Final[dict[str, ModelFormat]] = {
    kind.name: kind
    for kind in (
        ModelFormat("yolov8", _fits_yolov8, decode_yolov8, one_column_a_class=True),
        ModelFormat("yolov5", _fits_yolov5, decode_yolov5, one_column_a_class=True),
        ModelFormat("yolov6", _fits_yolox, decode_yolov5, one_column_a_class=True, denies=_denies_yolov6),
        ModelFormat("end_to_end", _fits_end_to_end, decode_end_to_end, suppressed=True, denies=_denies_end_to_end),
        ModelFormat(
            "rtdetr", _fits_rtdetr, decode_rtdetr, one_column_a_class=True, suppressed=True, denies=_denies_rtdetr
        ),
        ModelFormat("yolo_nas", _fits_yolo_nas, decode_yolo_nas, one_column_a_class=True, denies=_denies_yolo_nas),
        # YOLOX alone was trained on BGR, and on 0 to 255.
        ModelFormat("yolox", _fits_yolox, decode_yolox, one_column_a_class=True, rgb=False, input_max=255.0),
        ModelFormat(
            "yolox_decoded",
            _fits_yolox,
            decode_yolov5,
            one_column_a_class=True,
            rgb=False,
            input_max=255.0,
            denies=_denies_yolox_decoded,
            doubts=_doubts_yolox_decoded,
        ),
        ModelFormat(
            "detr",
            _fits_detr,
            decode_detr,
            one_column_a_class=True,
            suppressed=True,
            standardised=True,
            denies=_denies_detr,
        ),
        ModelFormat("labels_boxes_scores", _fits_labels_boxes_scores, decode_labels_boxes_scores, suppressed=True),
    )
}


def format_names() -> list[str]:
    """What a configuration may call a model's format."""
    return [AUTO, STACK_FORMAT, *MODEL_FORMATS]


# The name of a format in a configuration. A struct that holds one asks check_format in its __post_init__.
FormatName = Annotated[str, name_among(format_names())]


def check_format(field: str, name: str) -> None:
    """Raises ValueError for the name of no format."""
    check_name(field, name, format_names())
