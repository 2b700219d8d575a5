"""The int8 file: convolutions of the body in 8 bits, everything that makes pixels of them in float.

The hazard was met and is tested: with the decoder's additions quantised as well, coordinates saturate at the size of
the calibration images, and a model that is right at 640 px is blind in three quarters of a 1080p frame.
"""

import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)
from onnxruntime.quantization.shape_inference import quant_pre_process

from tools.train.compose import Composer

CALIBRATION_BATCHES: Final = 12  # of 32 samples
BATCH: Final = 32
LAST_CONVOLUTIONS: Final = 1  # the head: its outputs are coordinates


class _Samples(CalibrationDataReader):  # type: ignore[misc]
    def __init__(self, composer: Composer) -> None:
        self.batches = iter([composer.batch(BATCH)[0] for _ in range(CALIBRATION_BATCHES)])

    def get_next(self) -> dict[str, Any] | None:
        """The next input of the model, or None."""
        batch = next(self.batches, None)
        return None if batch is None else {"image": np.ascontiguousarray(batch)}


def body(model: onnx.ModelProto) -> list[str]:
    """Names of the nodes to quantise: every convolution but the head, and what joins them."""
    convolutions = [node.name for node in model.graph.node if node.op_type == "Conv"]
    names = [node.name for node in model.graph.node]
    end = names.index(convolutions[-LAST_CONVOLUTIONS])
    begin = names.index(convolutions[0])
    return names[begin:end]


def quantise(source: Path, target: Path, composer: Composer) -> None:
    """Write the int8 form of the float model `source`, its metadata kept."""
    with tempfile.TemporaryDirectory() as folder:
        ready = Path(folder) / "ready.onnx"
        quant_pre_process(str(source), str(ready), skip_symbolic_shape=True)
        nodes = body(onnx.load(str(ready)))
        quantize_static(
            str(ready),
            str(target),
            _Samples(composer),
            quant_format=QuantFormat.QDQ,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            per_channel=True,
            nodes_to_quantize=nodes,
            calibrate_method=CalibrationMethod.MinMax,
        )
    model = onnx.load(str(target))
    metadata = {entry.key: entry.value for entry in onnx.load(str(source)).metadata_props}
    onnx.helper.set_model_props(model, metadata)
    onnx.save(model, str(target))
