"""Where a model runs: what is asked for, what is there, what came of it."""

import re

import onnxruntime
import pytest

from edge.common.errors import ConfigError
from edge.config import DetectorConfig
from edge.detector.opening import where_it_runs
from edge.detector.providers import CPU_PROVIDER, chosen, placement, refuse_missing, with_options

THERE = ["TensorrtExecutionProvider", "CUDAExecutionProvider", "OpenVINOExecutionProvider", CPU_PROVIDER]


@pytest.mark.parametrize(
    ("names", "found"),
    [
        ((), [CPU_PROVIDER]),
        (("CPU",), [CPU_PROVIDER]),
        (("openvino",), ["OpenVINOExecutionProvider", CPU_PROVIDER]),
        (("CPU", "CUDA"), ["CUDAExecutionProvider", CPU_PROVIDER]),
        (("TensorrtExecutionProvider", "cuda", "CUDA"), [*THERE[:2], CPU_PROVIDER]),
    ],
)
def test_providers_are_named_short_or_long_and_the_cpu_is_last(names: tuple[str, ...], found: list[str]) -> None:
    assert chosen(names, THERE) == found


def test_one_that_is_not_there_is_named_with_what_is() -> None:
    with pytest.raises(ConfigError, match="'CUDA' is not in this machine's onnxruntime, which has OpenVINO, CPU"):
        chosen(("CUDA",), THERE[2:])


class Session:
    """A session that fell back to the CPU, as onnxruntime does without a driver."""

    def get_providers(self) -> list[str]:
        return [CPU_PROVIDER]


def test_one_that_does_not_start_is_an_error_and_no_slower_box() -> None:
    with pytest.raises(ConfigError, match="CUDA does not start; install what it needs"):
        refuse_missing(Session(), ["CUDAExecutionProvider", CPU_PROVIDER])
    refuse_missing(Session(), [CPU_PROVIDER])


def test_threads_are_told_to_providers_that_have_their_own() -> None:
    assert with_options([*THERE[2:]], 2) == [("OpenVINOExecutionProvider", {"num_of_threads": "2"}), (CPU_PROVIDER, {})]


def test_how_much_of_the_model_runs_where_is_said() -> None:
    told = hasattr(onnxruntime.InferenceSession, "get_provider_graph_assignment_info")
    said = where_it_runs(DetectorConfig())
    assert re.fullmatch(r"(\d+) of \1 nodes on CPU", said) if told else "does not tell" in said
    assert placement(Session()) == {}  # an onnxruntime that does not know
