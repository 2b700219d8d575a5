"""Tiny hand-made ONNX models that say exactly what a test wants them to say."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

OPSET = 17


def save(
    path: Path, nodes: list[Any], inputs: list[Any], outputs: list[Any], notes: dict[str, str], *constants: Any
) -> Path:
    graph = helper.make_graph(nodes, "test", inputs, outputs, list(constants))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)])
    model.ir_version = 9
    helper.set_model_props(model, notes)
    onnx.save(model, str(path))
    return path


def constant_model(
    path: Path,
    outputs: dict[str, NDArray[Any]],
    *,
    input_shape: tuple[int | str, ...] = (1, 3, 640, 640),
    input_type: int = TensorProto.FLOAT,
    notes: dict[str, str] | None = None,
) -> Path:
    """A model that gives the same outputs whatever it sees."""
    image = helper.make_tensor_value_info("images", input_type, input_shape)
    # ONNX Runtime wants every input used, so the image is read and thrown away.
    nodes = [helper.make_node("Shape", ["images"], ["ignored"])]
    nodes += [helper.make_node("Identity", [f"const_{name}"], [name]) for name in outputs]
    infos = [
        helper.make_tensor_value_info(name, helper.np_dtype_to_tensor_dtype(value.dtype), value.shape)
        for name, value in outputs.items()
    ]
    constants = [numpy_helper.from_array(value, f"const_{name}") for name, value in outputs.items()]
    return save(path, nodes, [image], infos, notes or {}, *constants)


def dark_dot_model(path: Path, *, kept: int = 8) -> Path:
    """A skyfix model that finds dark dots about 5 px wide, whether they move or not.

    Score: darkness of the 5 x 5 mean against 200, over 200. Boxes are 6 px, sigma 0.5 px, classes always 0.75 and 0.25.
    """
    image = helper.make_tensor_value_info("image", TensorProto.UINT8, ("b", "h", "w", 3))
    const = {
        "axes0": np.array([0], np.int64),
        "zero": np.array(0, np.int64),
        "level": np.array(200.0, np.float32),
        "scale": np.array(1 / 200, np.float32),
        "flat": np.array([0, -1], np.int64),
        "kept": np.array([kept], np.int64),
        "six": np.array([6.0, 6.0], np.float32),
        "probabilities": np.array([0.75, 0.25], np.float32),
        "half": np.array(0.5, np.float32),
        "three": np.array([3], np.int64),
        "two": np.array([2], np.int64),
        "one": np.array([1], np.int64),
        "last": np.array([-1], np.int64),
    }
    node = helper.make_node
    nodes = [
        node("Cast", ["image"], ["float"], to=TensorProto.FLOAT),
        node("Transpose", ["float"], ["chw"], perm=[0, 3, 1, 2]),
        node("Split", ["chw"], ["now", "past1", "past2"], axis=1),
        node("AveragePool", ["now"], ["smooth"], kernel_shape=[5, 5], pads=[2, 2, 2, 2], count_include_pad=0),
        node("Sub", ["level", "smooth"], ["dark"]),
        node("Mul", ["dark", "scale"], ["raw"]),
        node("Clip", ["raw", "zerof", "onef"], ["heat"]),
        node("MaxPool", ["heat"], ["peak"], kernel_shape=[9, 9], pads=[4, 4, 4, 4]),
        node("GreaterOrEqual", ["heat", "peak"], ["is_peak"]),
        node("Cast", ["is_peak"], ["is_peak_f"], to=TensorProto.FLOAT),
        node("Mul", ["heat", "is_peak_f"], ["peaks"]),
        node("Reshape", ["peaks", "flat"], ["peaks_flat"]),
        node("TopK", ["peaks_flat", "kept"], ["scores", "index"], axis=1),
        node("Shape", ["image"], ["shape"]),
        node("Gather", ["shape", "two_s"], ["width"], axis=0),
        node("Mod", ["index", "width"], ["column"]),
        node("Div", ["index", "width"], ["row"]),
        node("Cast", ["column"], ["u"], to=TensorProto.FLOAT),
        node("Cast", ["row"], ["v"], to=TensorProto.FLOAT),
        node("Unsqueeze", ["u", "last"], ["u1"]),
        node("Unsqueeze", ["v", "last"], ["v1"]),
        node("Mul", ["scores", "zerof"], ["zeros"]),
        node("Unsqueeze", ["zeros", "last"], ["zeros1"]),
        node("Add", ["zeros1", "six"], ["sizes"]),
        node("Concat", ["u1", "v1", "sizes"], ["boxes"], axis=2),
        node("Add", ["zeros1", "probabilities"], ["classes"]),
        node("Add", ["zeros", "half"], ["sigma"]),
    ]
    const |= {"zerof": np.array(0.0, np.float32), "onef": np.array(1.0, np.float32), "two_s": np.array(2, np.int64)}
    used = {name for each in nodes for name in each.input}
    constants = [numpy_helper.from_array(value, name) for name, value in const.items() if name in used]
    f = TensorProto.FLOAT
    outputs = [
        helper.make_tensor_value_info("boxes", f, ("b", kept, 4)),
        helper.make_tensor_value_info("scores", f, ("b", kept)),
        helper.make_tensor_value_info("classes", f, ("b", kept, 2)),
        helper.make_tensor_value_info("sigma", f, ("b", kept)),
    ]
    note = {"format": "skyfix", "classes": ["drone", "bird"], "stack_offsets_s": [0.0, 0.1, 0.2], "size_multiple": 8}
    return save(path, nodes, [image], outputs, {"skyfix": json.dumps(note)}, *constants)
