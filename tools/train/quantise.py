"""The int8 file: convolutions of the body in 8 bits, everything that makes pixels of them in float.

The hazard was met and is tested: with the decoder's additions quantised as well, coordinates saturate at the size of
the calibration images, and a model that is right at 640 px is blind in three quarters of a 1080p frame.
"""

import tempfile
from pathlib import Path
from typing import Any, Final

import onnx
import torch
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from tools.train.compose import Composer
from tools.train.net import cells
from tools.train.ports import FLOAT_INPUT

CALIBRATION_BATCHES: Final = 12
BATCH: Final = 32
HEADS: Final = ("/net/head/Conv", "/net/kind/kind.1/Conv")  # their outputs are coordinates and logits: float


class _Samples(CalibrationDataReader):  # type: ignore[misc]
    def __init__(self, composer: Composer) -> None:
        self.batches = iter([composer.batch(BATCH)[0] for _ in range(CALIBRATION_BATCHES)])

    def get_next(self) -> dict[str, Any] | None:
        """The next input of the model, or None."""
        batch = next(self.batches, None)
        if batch is None:
            return None
        return {FLOAT_INPUT: cells(torch.from_numpy(batch)).numpy()}


def body(graph: onnx.GraphProto) -> list[str]:
    """Names of the nodes to quantise: all that the heads are computed from, but not the heads."""
    maker = {output: node for node in graph.node for output in node.output}
    heads = [node for node in graph.node if node.name in HEADS]
    if len(heads) != len(HEADS):
        raise ValueError(f"expected the nodes {HEADS}, found {[node.name for node in heads]}")
    waiting = [name for head in heads for name in head.input]
    found: dict[str, None] = {}
    while waiting:
        node = maker.get(waiting.pop())
        if node is not None and node.name not in found:
            found[node.name] = None
            waiting += node.input
    return list(found)


def quantise(source: Path, target: Path, composer: Composer) -> None:
    """Write the int8 form of a float-input model."""
    with tempfile.TemporaryDirectory() as folder:
        ready = Path(folder) / "ready.onnx"
        quant_pre_process(str(source), str(ready), skip_symbolic_shape=True)
        quantize_static(
            str(ready),
            str(target),
            _Samples(composer),
            quant_format=QuantFormat.QDQ,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            per_channel=True,
            nodes_to_quantize=body(onnx.load(str(ready)).graph),
            calibrate_method=CalibrationMethod.MinMax,
        )
