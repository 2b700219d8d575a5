"""The input of a model file: grey bytes as the camera gives them, `(B, H, W, 3)`, and what the file says of itself.

Normalising 6 million floats costs more than the first convolution in 8 bits. Bytes are therefore declared to be what
they are, quantised numbers with a scale of 1/64 and a zero of 128: an int8 body takes them as they come.
"""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from tools.train.net import GREY_SCALE, MID_GREY, STRIDE

FLOAT_INPUT: Final = "normalised"
IMAGE: Final = "image"


def take_bytes(path: Path, about: dict[str, Any]) -> None:
    """Rewrite a model that takes `cells` to take uint8 `(B, H, W, 3)`; `about` is its skyfix note."""
    model = onnx.load(str(path))
    graph = model.graph
    kept = _without_own_quantising(list(graph.node))
    del graph.node[:]
    nodes = [*_cells(graph), *kept]
    _shapes_of_bytes(nodes)
    graph.node.extend(nodes)
    used = {name for node in graph.node for name in node.input}
    initializers = [value for value in graph.initializer if value.name in used]
    del graph.initializer[:]
    graph.initializer.extend(initializers)
    del graph.input[:]
    graph.input.append(helper.make_tensor_value_info(IMAGE, TensorProto.UINT8, ["batch", "height", "width", 3]))
    helper.set_model_props(model, {about["format"]: json.dumps(about)})
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def _cells(graph: onnx.GraphProto) -> list[onnx.NodeProto]:
    """The nodes that do what `net.cells` does, on bytes, with no shape to be computed; their constants."""
    constants = {
        "quarter_width": np.array([0, 0, -1, 3 * STRIDE], np.int64),
        "quarter_height": np.array([0, 0, -1, 3 * STRIDE**2], np.int64),
        "grey_scale": np.array(GREY_SCALE, np.float32),
        "grey_middle": np.array(MID_GREY, np.uint8),
    }
    graph.initializer.extend(numpy_helper.from_array(value, name) for name, value in constants.items())
    return [
        helper.make_node("Reshape", [IMAGE, "quarter_width"], ["rows"], name="rows"),
        helper.make_node("Transpose", ["rows"], ["columns"], name="columns", perm=[0, 2, 1, 3]),
        helper.make_node("Reshape", ["columns", "quarter_height"], ["cells"], name="cells"),
        helper.make_node("Transpose", ["cells"], ["planes"], name="planes", perm=[0, 3, 2, 1]),
        helper.make_node("DequantizeLinear", ["planes", "grey_scale", "grey_middle"], ["values"], name="values"),
    ]


def _without_own_quantising(nodes: list[onnx.NodeProto]) -> list[onnx.NodeProto]:
    """The nodes, their float input replaced by the dequantised bytes, the quantiser's own pair on it left out."""
    renamed = {FLOAT_INPUT: "values"}
    kept = []
    for node in nodes:
        if node.op_type in {"QuantizeLinear", "DequantizeLinear"} and node.input[0] in renamed:
            renamed[node.output[0]] = "values"
            continue
        for k, name in enumerate(node.input):
            node.input[k] = renamed.get(name, name)
        kept.append(node)
    return kept


def _shapes_of_bytes(nodes: list[onnx.NodeProto]) -> None:
    """Ask bytes for their shape, not the floats made of them: those would be made for nothing else."""
    bytes_of = {node.output[0]: node.input[0] for node in nodes if node.op_type == "DequantizeLinear"}
    for node in nodes:
        if node.op_type == "Shape":
            node.input[0] = bytes_of.get(node.input[0], node.input[0])
