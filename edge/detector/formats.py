"""What the numbers that come out of a detection model mean: six families, told apart by shape, or refused.

The hazard is the plausible reading. `[1, 8400, 6]` may be finished boxes or a one-class grid; read the wrong way it
still yields boxes, only wrong ones. So a format is recognised where shapes, names or the author's notes leave one
reading, and refused with a request to name it where they leave several.

Each decoder takes the outputs of one image and gives corner-origin input pixels; rows below `score_min` are left out
before anything costly is done with them.
"""

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array
from edge.common.errors import ModelError
from edge.detector.session import Model

Format = Literal["skyfix", "yolov8", "end_to_end", "yolox", "detr", "labels_boxes_scores"]
Outputs = Sequence[NDArray[Any]]

YOLOX_STRIDES: Final = (8, 16, 32)
SKYFIX_NOTE: Final = "skyfix"  # the note that our own models carry
CHOICE: Final = 'set detector.format to "yolov8", "end_to_end", "yolox", "detr" or "labels_boxes_scores"'


@dataclass(frozen=True)
class Candidates:
    """Boxes of one image, input pixels from the corner. centre, size: `(N, 2)`. score: `(N,)`. classes: `(N, C)`."""

    centre: Array
    size: Array
    score: Array
    classes: Array


def recognise(model: Model, input_px: tuple[int, int]) -> Format:
    """The one format that a model's outputs can be. input_px: width, height. Raises ModelError if there are several."""
    if SKYFIX_NOTE in model.notes:
        return "skyfix"
    shapes = [port.shape for port in model.outputs]
    if len(shapes) == 3 and sorted(map(len, shapes)) == [2, 2, 3]:
        return "labels_boxes_scores"
    if len(shapes) == 2 and all(len(shape) == 3 for shape in shapes) and any(shape[2] == 4 for shape in shapes):
        return "detr"
    if len(shapes) == 1 and len(shapes[0]) == 3:
        return _one_output(model, shapes[0][1], shapes[0][2], input_px)
    raise ModelError(f"has outputs of shapes {shapes}, no known format", where=model.path, action=CHOICE)


def _one_output(model: Model, rows: int | None, columns: int | None, input_px: tuple[int, int]) -> Format:
    """One output `[1, rows, columns]`: boxes lie along the longer side."""
    grid = sum((input_px[0] // stride) * (input_px[1] // stride) for stride in YOLOX_STRIDES)
    known = class_names_in(model)
    if rows is not None and rows >= 5 and (columns is None or columns > rows) and known in (None, rows - 4):
        return "yolov8"
    if columns is not None and rows == grid and known in ({columns - 5} if columns == 6 else {None, columns - 5}):
        return "yolox"
    if columns == 6 and rows is not None and rows > 6 and rows != grid:
        return "end_to_end"
    shape = f"[1, {rows or '?'}, {columns or '?'}]"
    named = "" if known is None else f" with {known} class names"
    raise ModelError(
        f"has one output {shape}{named}, which can be read in several ways", where=model.path, action=CHOICE
    )


def class_names_in(model: Model) -> int | None:
    """How many class names the model carries; None if it carries none."""
    names = read_class_names(model)
    return len(names) if names else None


def read_class_names(model: Model) -> tuple[str, ...]:
    """The class names that the model's author wrote into it, as Ultralytics does; empty if there are none."""
    try:
        names = ast.literal_eval(model.notes.get("names", "()"))
    except (ValueError, SyntaxError) as error:
        action = "set detector.class_names"
        raise ModelError(f"its note of class names is garbled ({error})", where=model.path, action=action) from error
    return tuple(str(names[key]) for key in sorted(names)) if isinstance(names, dict) else tuple(map(str, names))


def decode_yolov8(outputs: Outputs, input_px: tuple[int, int], score_min: float) -> Candidates:
    """`[1, 4 + nc, N]`: centre and size in input pixels, scores already between 0 and 1 (Ultralytics v8, 11)."""
    table = outputs[0][0]
    score = table[4:].max(axis=0)
    table = table[:, score >= score_min].astype(np.float64)
    return Candidates(table[:2].T, table[2:4].T, table[4:].max(axis=0, initial=0.0), table[4:].T)


def decode_end_to_end(outputs: Outputs, input_px: tuple[int, int], score_min: float) -> Candidates:
    """`[1, N, 6]`: two corners, score, class; already suppressed (YOLOv10 and Ultralytics' end-to-end heads)."""
    table = outputs[0][0].astype(np.float64)
    table = table[table[:, 4] >= score_min]
    return _from_corners(table[:, :4], table[:, 4], _whole(table[:, 5]))


def decode_yolox(outputs: Outputs, input_px: tuple[int, int], score_min: float) -> Candidates:
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


def _yolox_grid(input_px: tuple[int, int]) -> tuple[Array, Array]:
    cells, strides = [], []
    for stride in YOLOX_STRIDES:
        across, down = np.meshgrid(np.arange(input_px[0] // stride), np.arange(input_px[1] // stride))
        cells.append(np.stack([across.ravel(), down.ravel()], axis=1))
        strides.append(np.full((across.size, 1), float(stride)))
    return np.concatenate(cells).astype(np.float64), np.concatenate(strides)


def decode_detr(outputs: Outputs, input_px: tuple[int, int], score_min: float) -> Candidates:
    """Boxes `[1, N, 4]`, centre and size as shares of the input, and logits `[1, N, nc]` (RF-DETR)."""
    first_is_boxes = outputs[0].shape[2] == 4
    boxes, logits = (outputs[0], outputs[1]) if first_is_boxes else (outputs[1], outputs[0])
    classes = 1.0 / (1.0 + np.exp(-logits[0].astype(np.float64)))
    score = classes.max(axis=1)
    keep = score >= score_min
    boxes = boxes[0][keep].astype(np.float64) * (*input_px, *input_px)
    return Candidates(boxes[:, :2], boxes[:, 2:], score[keep], classes[keep])


def decode_labels_boxes_scores(outputs: Outputs, input_px: tuple[int, int], score_min: float) -> Candidates:
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


Decoder = Callable[[Outputs, tuple[int, int], float], Candidates]
DECODERS: Final[dict[str, Decoder]] = {
    "yolov8": decode_yolov8,
    "end_to_end": decode_end_to_end,
    "yolox": decode_yolox,
    "detr": decode_detr,
    "labels_boxes_scores": decode_labels_boxes_scores,
}
SUPPRESSED_ALREADY: Final = frozenset({"end_to_end", "detr", "labels_boxes_scores"})
