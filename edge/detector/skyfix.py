"""The shipped kind of model: a stack of grey frames in, peaks out, at any size.

The same network looks at a batch of small crops and at a whole frame. Its three channels are the frame now and 100 and
200 ms ago; the suppression of neighbours and the choice of the best are inside it, so what comes out is few and final.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array
from edge.common.errors import ModelError
from edge.config import DetectorConfig
from edge.detector.detections import Detections
from edge.detector.session import Model

OUTPUTS: Final = ("boxes", "scores", "classes", "sigma")
MULTIPLE_PX: Final = 16  # sides of the network's input, where its note does not say
SKYFIX_TRACK_SCORE: Final = 0.5  # measured on the training clips: objects 0.6 and more, leaves 0.3 to 0.45
DEFAULT_OFFSETS_S: Final = (0.0, 0.1, 0.2)


class StackNet:
    """A skyfix model. Thread-safe: crops and full scans may run side by side."""

    def __init__(self, model: Model) -> None:
        """Raises ModelError if its ports or its note are not what the format promises."""
        note = model.json_note("skyfix")
        if not isinstance(note, dict):
            raise ModelError("carries no skyfix note", where=model.path, action="set detector.format to what it is")
        names = [port.name for port in model.outputs]
        if len(model.inputs) != 1 or sorted(names) != sorted(OUTPUTS):
            action = f"give one input and the outputs {', '.join(OUTPUTS)}"
            raise ModelError(f"has outputs {', '.join(names)}", where=model.path, action=action)
        self._model = model
        self._input = model.inputs[0].name
        self._order = [names.index(name) for name in OUTPUTS]
        self.class_names: tuple[str, ...] = tuple(note.get("class_names") or note.get("classes") or ())
        offsets = tuple(float(offset) for offset in note.get("stack_offsets_s", DEFAULT_OFFSETS_S))
        self.multiple_px = int(note.get("size_multiple", MULTIPLE_PX))
        self.past_s = tuple(abs(offset) for offset in offsets[1:])
        if len(self.past_s) != 2:
            raise ModelError(f"stacks {len(offsets)} frames, not 3", where=model.path, action="give a stack of three")
        self._check_by_running()

    def _check_by_running(self) -> None:
        found = self.run(np.zeros((1, 64, 64, 3), np.uint8), 0.0)[0]
        if self.class_names and found.classes.shape[1] != len(self.class_names):
            raise ModelError(
                f"has {found.classes.shape[1]} classes and {len(self.class_names)} names for them",
                where=self._model.path,
                action="export it again",
            )

    def run(self, stack: NDArray[np.uint8], score_min: float) -> list[Detections]:
        """What is in each image of `(B, H, W, 3)`, in its own pixels."""
        found, index = self.run_together(stack, score_min)
        return [found.where(index == k) for k in range(len(stack))]

    def run_together(self, stack: NDArray[np.uint8], score_min: float) -> tuple[Detections, NDArray[np.intp]]:
        """What is in the images of `(B, H, W, 3)`, and the number of the image `(N,)` each is in."""
        results = self._model.run({self._input: stack})
        boxes, scores, classes, sigma = (results[index] for index in self._order)
        if boxes.ndim != 3 or boxes.shape[2] != 4 or scores.shape != boxes.shape[:2] or sigma.shape != scores.shape:
            shapes = [value.shape for value in results]
            raise ModelError(f"answers with shapes {shapes}", where=self._model.path, action="export it again")
        usable = (scores >= score_min) & np.isfinite(boxes).all(axis=2) & np.isfinite(scores)
        return _rows(*(value[usable] for value in (boxes, scores, classes, sigma))), np.nonzero(usable)[0]


class StackDetector:
    """What every detector has that looks with a StackNet at grey frames, one after the other."""

    colour = False
    remembers = True
    track_score = SKYFIX_TRACK_SCORE

    def __init__(self, net: StackNet, config: DetectorConfig) -> None:
        self._net = net
        self._config = config
        self.class_names = config.class_names or net.class_names


def _rows(boxes: NDArray[Any], scores: NDArray[Any], classes: NDArray[Any], sigma: NDArray[Any]) -> Detections:
    table = boxes.astype(np.float64)
    size: Array = np.maximum(table[:, 2:], 1e-3)
    return Detections(
        table[:, :2],
        size,
        np.clip(scores.astype(np.float64), 0.0, 1.0),
        sigma.astype(np.float64),
        np.clip(classes.astype(np.float64), 0.0, 1.0),
    )
