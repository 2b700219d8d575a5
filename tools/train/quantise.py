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
FEATURES: Final = ("neck.2/Relu", "kind.0.2/Relu")  # how the nodes end that make what the heads are computed from
CARRIES: Final = (
    "Transpose",
    "Reshape",
    "Flatten",
    "Gather",
)  # from features to heads: bytes are cheaper carried than floats
HEAD: Final = "MatMul"  # its inputs are in 8 bits, its outputs, coordinates and logits, in float


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
    """Names of the nodes to quantise: the convolutions, what carries their results to the heads, and heat."""
    maker = {output: node for node in graph.node for output in node.output}
    features = [node for node in graph.node if node.name.endswith(FEATURES)]
    if len(features) != len(FEATURES):
        raise ValueError(f"expected the nodes .../{FEATURES}, found {[node.name for node in features]}")
    waiting = [name for node in features for name in node.output]
    found: dict[str, None] = {}
    while waiting:
        node = maker.get(waiting.pop())
        if node is not None and node.name not in found:
            found[node.name] = None
            waiting += node.input
    carried = {name for node in features for name in node.output}
    for node in graph.node:
        if node.op_type in CARRIES and node.input[0] in carried:
            found[node.name] = None
            carried.update(node.output)
    heat = next(node for node in graph.node if node.op_type == HEAD and node.input[0] in carried)
    return [*found, heat.name]


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
            extra_options={"OpTypesToExcludeOutputQuantization": [HEAD]},
        )
