"""An ONNX Runtime session as a camera box wants it: one thread, no spinning, every complaint in plain words.

The library's defaults take every core and spin on them while waiting; beside a second process that was measured to slow
both by half and more. So a session has one thread unless told otherwise, and frames are worked on
side by side instead.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from edge.common.errors import ModelError
from edge.detector.providers import SAYS_WHERE, chosen, refuse_missing, with_options

DTYPES: Final = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}
ANOTHER_OPSET: Final = "export it again as ONNX, opset 21 or lower"
FIRST_LINE: Final = 400  # characters of what the library says: a path is in it
_ERRORS_ONLY: Final = 3  # ONNX Runtime's log level


@dataclass(frozen=True)
class ModelTensor:
    """An input or output: a name, and a shape in which None is free."""

    name: str
    shape: tuple[int | None, ...]
    type: str


@dataclass(frozen=True)
class Model:
    """An opened model: its session, its ports and what its author wrote about it."""

    path: str
    session: ort.InferenceSession
    inputs: tuple[ModelTensor, ...]
    outputs: tuple[ModelTensor, ...]
    notes: dict[str, str]

    def run(self, feeds: dict[str, NDArray[Any]]) -> list[NDArray[Any]]:
        """The outputs, in order. Raises ModelError if the model fails on this input."""
        try:
            return self.session.run(None, feeds)  # type: ignore[no-any-return]
        except _ORT_ERRORS as error:
            shapes = ", ".join(f"{name} {value.shape}" for name, value in feeds.items())
            raise ModelError(
                f"fails on {shapes} ({_first_line(error)})", where=self.path, action="check the model's input size"
            ) from error

    def json_note(self, key: str) -> Any:
        """A note that holds JSON; None if there is none. Raises ModelError if it holds something else."""
        if key not in self.notes:
            return None
        try:
            return json.loads(self.notes[key])
        except json.JSONDecodeError as error:
            raise ModelError(
                f"its note {key!r} is not JSON ({error})", where=self.path, action="export the model again"
            ) from error


_STATE: Final = ort.capi.onnxruntime_pybind11_state
# ONNX Runtime derives its errors from Exception alone, one class a status.
_ORT_ERRORS: Final = (
    _STATE.Fail,
    _STATE.InvalidArgument,
    _STATE.InvalidGraph,
    _STATE.InvalidProtobuf,
    _STATE.NoModel,
    _STATE.NoSuchFile,
    _STATE.NotImplemented,
    _STATE.RuntimeException,
    RuntimeError,
    ValueError,
)


def open_model(path: Path | str, threads: int = 1, providers: Sequence[str] = ()) -> Model:
    """A model ready to run, on providers or else the CPU. Raises ModelError if it is none, ConfigError."""
    wanted = chosen(providers)
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = _ERRORS_ONLY
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    options.add_session_config_entry(SAYS_WHERE, "1")
    if not Path(path).is_file():
        raise ModelError("no such model file", where=str(path), action="give the path of an ONNX file")
    try:
        session = ort.InferenceSession(str(path), options, providers=with_options(wanted, threads))
    except _ORT_ERRORS as error:
        what = f"is no model that loads ({_first_line(error)})"
        raise ModelError(what, where=str(path), action=_remedy(Path(path), str(error))) from error
    refuse_missing(session, wanted)
    notes = dict(session.get_modelmeta().custom_metadata_map)
    return Model(str(path), session, _ports(session.get_inputs()), _ports(session.get_outputs()), notes)


def _remedy(path: Path, error: str) -> str:
    """What helps, by how the file begins and by what the library says of it."""
    with path.open("rb") as file:
        head = file.read(64)
    external = re.search(r'[^\s"\[\]]+\.data\b|[^\s"\[\]]+\.bin\b', error)
    remedies = (
        (not head, "the file is empty: copy it again"),
        (
            head.startswith(b"version https://git-lfs"),
            "it is a pointer of Git LFS: git lfs pull",
        ),
        (head.startswith((b"PK\x03\x04", b"\x80")), "it is a PyTorch file: export it as ONNX"),
        (external is not None, f"its weights lie beside it: put {external and Path(external[0]).name} in its folder"),
        (
            "opset" in error or "IR version" in error or "ir_version" in error,
            "export it again as ONNX, opset 21 or lower",
        ),
        ("not a registered function" in error, "export it again without operators of TensorRT or another runtime"),
        (
            "Protobuf" in error or "protobuf" in error,
            "it is cut off or no ONNX file: fetch it again or export it again",
        ),
    )
    return next((remedy for holds, remedy in remedies if holds), ANOTHER_OPSET)


def _ports(nodes: list[Any]) -> tuple[ModelTensor, ...]:
    return tuple(
        ModelTensor(node.name, tuple(size if isinstance(size, int) else None for size in node.shape), node.type)
        for node in nodes
    )


def _first_line(error: BaseException) -> str:
    return str(error).strip().splitlines()[0][:FIRST_LINE] if str(error).strip() else type(error).__name__
