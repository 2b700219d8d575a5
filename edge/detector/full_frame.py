"""Any user's model on the whole frame: for moving cameras, and for those who trained their own.

What a model wants at its input (layout, type, range, order of colours) is read from the model. The outputs are decoded
by `edge/detector/formats.py`; here frames become inputs and boxes become raw frame pixels again.
"""

from dataclasses import dataclass, replace
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image, Picture
from edge.common.arrays import Array
from edge.common.errors import ModelError
from edge.config import DetectorConfig
from edge.detector.detections import Detections, nothing, together
from edge.detector.formats import (
    AUTO,
    IMAGENET_MEAN,
    IMAGENET_STD,
    MODEL_FORMATS,
    Candidates,
    ModelFormat,
    fitting,
    garbled_names,
    one_of,
    read_class_names,
)
from edge.detector.letterbox import Letterbox
from edge.detector.nms import suppress
from edge.detector.session import DTYPES, Model
from edge.detector.trial import contradiction, trial_picture

TILE_OVERLAP: Final = 0.2  # share of a tile: an object up to a fifth of it is whole in some tile
TRACK_SCORE: Final = 0.3  # models differ: little more than detector.score_min, and gate.score_confirm for the rest
TILE_IOU: Final = 0.2  # the same object seen in two tiles overlaps itself at least so much


@dataclass(frozen=True)
class InputSpec:
    """What a model's image input looks like. size_px: width, height."""

    name: str
    size_px: tuple[int, int]
    channels_first: bool
    channels: int
    dtype: Any


def input_spec(model: Model, wanted_px: tuple[int, int] | None) -> InputSpec:
    """The image input of a model; wanted_px where its size is free. Raises ModelError."""
    port = model.inputs[0]
    if len(port.shape) != 4 or port.type not in DTYPES:
        action = "give a model with one image input of floats or bytes"
        raise ModelError(f"its input {port.name} {port.shape} {port.type} is no image", where=model.path, action=action)
    batch, a, b, c = port.shape
    if batch not in (None, 1):
        action = "export it again for one image: batch 1"
        raise ModelError(f"takes {batch} images at once", where=model.path, action=action)
    if a in (1, 3):
        channels, height, width, first = a, b, c, True
    elif c in (1, 3):
        channels, height, width, first = c, a, b, False
    else:
        action = "give a model for images of 1 or 3 channels"
        raise ModelError(f"its input {port.shape} has no channel axis", where=model.path, action=action)
    size_px = _input_size(model, width, height, wanted_px)
    return InputSpec(port.name, size_px, first, channels, DTYPES[port.type])


def _input_size(
    model: Model, width: int | None, height: int | None, wanted_px: tuple[int, int] | None
) -> tuple[int, int]:
    if width and height:
        if wanted_px not in (None, (width, height)):
            action = f"leave detector.input_size_px out or make it [{width}, {height}]"
            raise ModelError(f"its input is fixed at {width} x {height}", where=model.path, action=action)
        return width, height
    if wanted_px:
        return wanted_px
    noted = model.json_note("imgsz")  # Ultralytics writes [height, width]
    if isinstance(noted, list) and len(noted) == 2:
        return int(noted[1]), int(noted[0])
    action = "set detector.input_size_px = [width, height]"
    raise ModelError("its input size is free and nobody says which to use", where=model.path, action=action)


class FullFrame:
    """One model run over each whole frame, or over tiles of it. Frames may be given from several threads at once."""

    def __init__(self, model: Model, config: DetectorConfig) -> None:
        """Raises ModelError if the model's shapes cannot be understood."""
        if config.class_names and garbled_names(model):
            model = replace(model, notes={**model.notes, "names": str(config.class_names)})
        self._model = model
        self._config = config
        self._input = input_spec(model, config.input_size_px)
        self._targets_input = next((port.name for port in model.inputs[1:]), None)
        self.colour = self._input.channels == 3
        self.remembers = False
        self.track_score = TRACK_SCORE
        self.class_names = config.class_names or read_class_names(model)
        self._frames = 0
        self._format = self._choose()
        self._check_by_running()

    def _choose(self) -> ModelFormat:
        """The format that shapes allow and a run on a trial picture does not contradict. Raises ModelError."""
        if self._config.format != AUTO:
            kind = MODEL_FORMATS[self._config.format]
            if why := self._denied(kind):
                action = "leave detector.format out, or name another"
                raise ModelError(f"as {kind.name} it gives {why}", where=self._model.path, action=action)
            return kind
        left, denied = [], {}
        for kind in fitting(self._model, self._input.size_px):
            if why := self._denied(kind):
                denied[kind.name] = why
            else:
                left.append(kind)
        return one_of(self._model, left, denied)

    def _denied(self, kind: ModelFormat) -> str:
        """Why the model's answer to a trial picture is not of a format; empty if it may be."""
        self._format = kind
        outputs = self._outputs(trial_picture(self._input.size_px, 3 if self.colour else 1))
        try:
            found = self._decoded(outputs, 0.0)
        except ModelError:
            if self._config.format != AUTO:
                raise
            return "shapes of another"
        why = kind.denies(outputs, self._input.size_px) or (self._config.format == AUTO and kind.doubts(outputs)) or ""
        return why or contradiction(found, self._input.size_px, padded=kind.suppressed)

    def _check_by_running(self) -> None:
        """Run once on grey, so that a wrong shape is found at the start and not in flight."""
        width, height = self._input.size_px
        found = self._candidates(np.full((height, width, 3)[: 3 if self.colour else 2], 114, np.uint8))
        classes = found.classes.shape[1]
        if self._format.one_column_a_class and self.class_names and len(self.class_names) != classes:
            raise ModelError(
                f"has {classes} classes, but {len(self.class_names)} class names are given",
                where=self._model.path,
                action="correct detector.class_names",
            )

    def detect(self, frame: Picture, expected_px: Array) -> Detections:
        """The objects in a frame; `expected_px` is not needed here."""
        self._frames += 1
        if not self._config.tiles:
            return self._limit(self._detect_in(frame.image, (0, 0)))
        parts = [self._detect_in(image, corner) for image, corner in tiles(frame.image, self._input.size_px)]
        merged = together(parts, max(part.classes.shape[1] for part in parts))
        return self._limit(merged.where(suppress(merged.centre_px, merged.size_px, merged.score, TILE_IOU)))

    def _limit(self, found: Detections) -> Detections:
        order = np.argsort(-found.score, kind="stable")[: self._config.max_detections]
        return found.where(order)

    def _detect_in(self, image: Image, corner_px: tuple[int, int]) -> Detections:
        box = Letterbox((image.shape[1], image.shape[0]), self._input.size_px)
        found = self._candidates(box.apply(image))
        if not self._format.suppressed:
            # Classes compete: one object in the sky called both drone and bird would become two targets.
            found = _pick(found, suppress(found.centre, found.size, found.score, self._config.nms_iou))
        if not len(found.score):
            return nothing(max(found.classes.shape[1], len(self.class_names)))
        return Detections(
            box.to_frame_px(found.centre) + corner_px,
            box.to_frame_size(found.size),
            np.clip(found.score, 0.0, 1.0),
            np.full(len(found.score), np.nan),
            _widen(found.classes, len(self.class_names)),
        )

    def _outputs(self, image: Image) -> list[NDArray[Any]]:
        feeds: dict[str, NDArray[Any]] = {self._input.name: self._tensor(image)}
        if self._targets_input is not None:  # asked for the size its boxes are to be scaled to
            feeds[self._targets_input] = np.array([self._input.size_px], dtype=np.int64)
        outputs = self._model.run(feeds)
        if any(output.shape[0] != 1 for output in outputs):
            raise ModelError("answers one image with several", where=self._model.path, action=_EXPORT)
        return outputs

    def _decoded(self, outputs: list[NDArray[Any]], score_min: float) -> Candidates:
        try:
            return self._format.decode(outputs, self._input.size_px, score_min)
        except (IndexError, ValueError, StopIteration) as error:
            shapes = [output.shape for output in outputs]
            raise ModelError(
                f"outputs {shapes} are not {self._format.name}", where=self._model.path, action=_EXPORT
            ) from error

    def _candidates(self, image: Image) -> Candidates:
        found = self._decoded(self._outputs(image), self._config.score_min)
        finite = (
            (found.size > 0).all(axis=1)
            & np.isfinite(found.centre).all(axis=1)
            & np.isfinite(found.size).all(axis=1)
            & np.isfinite(found.score)
        )
        return found if finite.all() else _pick(found, np.flatnonzero(finite))

    def _tensor(self, image: Image) -> NDArray[Any]:
        """The image as the model wants it, with a batch axis."""
        rgb = self.colour and self._format.rgb
        scale = 1.0 if self._input.dtype == np.uint8 else self._format.input_max / 255
        if self._input.channels_first and self._input.dtype != np.uint8:
            values = cv2.dnn.blobFromImage(image, scale, swapRB=rgb).astype(self._input.dtype, copy=False)
        else:
            planes = (cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if rgb else image).reshape(1, *image.shape[:2], -1)
            planes = planes.transpose(0, 3, 1, 2) if self._input.channels_first else planes
            values = np.ascontiguousarray(planes, dtype=self._input.dtype)
            values = values if scale == 1.0 else values * self._input.dtype(scale)
        return self._standardise(values) if self._format.standardised and self.colour else values

    def _standardise(self, values: NDArray[Any]) -> NDArray[Any]:
        shape = (1, 3, 1, 1) if self._input.channels_first else (1, 1, 1, 3)
        mean, std = (np.array(c, values.dtype).reshape(shape) for c in (IMAGENET_MEAN, IMAGENET_STD))
        return (values - mean) / std  # type: ignore[no-any-return]

    def counters(self) -> dict[str, float]:
        """Frames looked at."""
        return {"detector_frames": float(self._frames)}

    def close(self) -> None:
        """Nothing to end."""


_EXPORT: Final = "export it again for one image, or correct detector.format"


def tiles(image: Image, size_px: tuple[int, int]) -> list[tuple[Image, tuple[int, int]]]:
    """Overlapping pieces of at most size_px (width, height), each with its corner in the image."""
    across = _starts(image.shape[1], size_px[0])
    down = _starts(image.shape[0], size_px[1])
    return [(image[y : y + size_px[1], x : x + size_px[0]], (x, y)) for y in down for x in across]


def _starts(length: int, tile: int) -> list[int]:
    if length <= tile:
        return [0]
    count = int(np.ceil((length - tile) / (tile * (1 - TILE_OVERLAP)))) + 1
    return [round(k * (length - tile) / (count - 1)) for k in range(count)]


def _pick(found: Candidates, keep: NDArray[np.intp]) -> Candidates:
    return Candidates(found.centre[keep], found.size[keep], found.score[keep], found.classes[keep])


def _widen(classes: Array, columns: int) -> Array:
    """As many columns as there are names; an end-to-end head only shows the classes that occurred."""
    missing = columns - classes.shape[1]
    return np.pad(classes, ((0, 0), (0, missing))) if missing > 0 else classes
