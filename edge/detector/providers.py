"""Where a model runs: ONNX Runtime's execution providers, as the configuration names them.

The hazard is the silent step back to the CPU. A provider whose driver or library is missing is passed over by the
library with a line in its log, and the box is ten times slower than it was bought to be. So a provider that is named
and does not run is an error, what there is is listed, and `edge-node check` says how much of the model runs where.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

import onnxruntime as ort

from edge.common.errors import ConfigError

CPU_PROVIDER: Final = "CPUExecutionProvider"
SUFFIX: Final = "ExecutionProvider"
SAYS_WHERE: Final = "session.record_ep_graph_assignment_info"  # has a session remember which provider took which node
# What a provider is told beside its name. OpenVINO has threads of its own and takes all cores without.
THREADS_OPTION: Final = {"OpenVINOExecutionProvider": "num_of_threads"}


def available() -> list[str]:
    """The providers of this machine's ONNX Runtime, in its own order."""
    return list(ort.get_available_providers())


def chosen(names: Sequence[str], there: Sequence[str] | None = None) -> list[str]:
    """ONNX Runtime's names of those that are asked for, the CPU last of all. Raises ConfigError for one not there."""
    there = available() if there is None else there
    short = {name.lower(): name for name in there} | {name.removesuffix(SUFFIX).lower(): name for name in there}
    found = []
    for name in names:
        if name.lower() not in short:
            listed = ", ".join(name.removesuffix(SUFFIX) for name in there)
            raise ConfigError(
                f"{name!r} is not in this machine's onnxruntime, which has {listed}",
                where="detector.providers",
                action="name one of those, or install the onnxruntime that has it in place of this one",
            )
        found.append(short[name.lower()])
    return [*(name for name in dict.fromkeys(found) if name != CPU_PROVIDER), CPU_PROVIDER]


def with_options(providers: Sequence[str], threads: int) -> list[Any]:
    """Providers as a session takes them, each with what it is told."""
    return [
        (name, {THREADS_OPTION[name]: str(threads)}) if name in THREADS_OPTION else (name, {}) for name in providers
    ]


def refuse_missing(session: Any, wanted: Sequence[str]) -> None:
    """Raises ConfigError where a session runs without a provider that was asked for."""
    missing = [name for name in wanted if name not in session.get_providers()]
    if missing:
        names = ", ".join(name.removesuffix(SUFFIX) for name in missing)
        action = "install what it needs (its driver, its libraries), or leave it out"
        raise ConfigError(f"{names} does not start", where="detector.providers", action=action)


def placement(session: Any) -> dict[str, int]:
    """How many nodes of a model run where; empty where this ONNX Runtime does not tell."""
    tell = getattr(session, "get_provider_graph_assignment_info", None)
    if tell is None:
        return {}
    nodes: Counter[str] = Counter()
    for part in tell():
        nodes[part.ep_name.removesuffix(SUFFIX)] += len(part.get_nodes())
    return dict(nodes.most_common())
