"""Which outputs the configuration wants, and how they are opened: the one place that knows.

`[mavlink]` is opened where it has an endpoint. Every table `[output.NAME]` is an output too: NAME is a folder in
calib/station/outputs, or `module` names any module that can be imported; the rest of the table is the output's own.
The module has `open_output(table, context)` (output.py), and `NEVER_BLOCKS = True` if it may be called in the loop.
"""

import importlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import msgspec

from calib.station.config import BaseConfig, SiteSection
from calib.station.core.stored_state import StoredState
from calib.station.outputs.guarded import GuardedOutput
from calib.station.outputs.output import Output, OutputContext
from calib.station.outputs.outputs import Outputs
from calib.station.outputs.threaded import ThreadedOutput
from edge.common.errors import ConfigError

PACKAGE: Final = "calib.station.outputs"
MAVLINK: Final = "mavlink"  # has a section of its own
ENDPOINTS: Final = "endpoint"  # where an output of several receivers lists them


@dataclass(frozen=True)
class OutputHost:
    """What the station gives to its outputs. folder: what relative paths are relative to. state: of earlier starts.

    record: puts (topic below the station's key, payload) into the recording, from the loop's thread.
    keep_signing_ticks: has a signing time survive a restart.
    """

    site: SiteSection
    folder: Path
    state: StoredState
    record: Callable[[str, bytes], None]
    keep_signing_ticks: Callable[[int], None]

    def context(self, where: str, record: Callable[[str, bytes], None]) -> OutputContext:
        """For the output whose place in the configuration is `where`. record: as OutputContext has it."""
        state = self.state
        return OutputContext(
            where, self.site, self.folder, state.epoch, state.signing_ticks, record, self.keep_signing_ticks
        )


@dataclass(frozen=True)
class WantedOutput:
    """An output that the configuration asks for. topic: under which what it sends is recorded."""

    name: str
    module: str
    table: dict[str, Any]
    where: str
    topic: str

    @property
    def title(self) -> str:
        """As a person finds it in the configuration: its name, and where it sends if that is one place."""
        endpoints = self.table.get(ENDPOINTS)
        one = endpoints[0] if isinstance(endpoints, list) and len(endpoints) == 1 else self.table
        url = one.get("url", "") if isinstance(one, dict) else ""
        return f"{self.name} {url}".strip()

    def one_by_one(self) -> Iterator["WantedOutput"]:
        """The same with each receiver alone, so that one that can't be reached does not hide how the others are."""
        endpoints = self.table.get(ENDPOINTS)
        if not isinstance(endpoints, list):
            yield self
            return
        for endpoint in endpoints:
            yield replace(self, table=self.table | {ENDPOINTS: [endpoint]})


def wanted(config: BaseConfig) -> list[WantedOutput]:
    """The outputs that a configuration asks for. Raises ConfigError if MAVLink is asked for in the wrong place."""
    if MAVLINK in config.output:
        raise ConfigError("MAVLink has a section of its own", where="[output.mavlink]", action="write it as [mavlink]")
    found = [
        WantedOutput(name, table.get("module", _own(name)), table, f"[output.{name}]", f"output_{name}")
        for name, table in config.output.items()
    ]
    if config.mavlink.endpoint:
        table = msgspec.to_builtins(config.mavlink)
        found.insert(0, WantedOutput(MAVLINK, _own(MAVLINK), table, f"[{MAVLINK}]", MAVLINK))
    return found


def open_outputs(config: BaseConfig, host: OutputHost, stack: ExitStack) -> Outputs:
    """All outputs that are wanted, closed with the stack. Raises ConfigError if one can't be opened."""
    return Outputs([open_output(each, host, stack) for each in wanted(config)])


def open_output(one: WantedOutput, host: OutputHost, stack: ExitStack) -> Output:
    """One output, guarded, and in a thread of its own unless it never blocks. Raises ConfigError."""
    module = _loaded(one)
    table = {key: value for key, value in one.table.items() if key != "module"}

    def record_frame(endpoint: str, frame: bytes) -> None:
        payload = b'{"endpoint":"%s","frame":"%s"}' % (endpoint.encode(), frame.hex().encode())
        host.record(one.topic, payload)

    def opened(record: Callable[[str, bytes], None]) -> Output:
        made: Output = module.open_output(table, host.context(one.where, record))
        return made

    if getattr(module, "NEVER_BLOCKS", False):
        return stack.enter_context(closing(GuardedOutput(one.name, opened(record_frame))))
    return stack.enter_context(ThreadedOutput(one.name, opened, record_frame))


def _loaded(one: WantedOutput) -> ModuleType:
    try:
        module = importlib.import_module(one.module)
    except ImportError as error:
        raise ConfigError(
            f"there is no output {one.name!r} ({error})",
            where=one.where,
            action=f"name one of these: {', '.join(available())}; or give `module` as Python imports it",
        ) from error
    if not hasattr(module, "open_output"):
        raise ConfigError(
            f"{one.module} is no output: it has no open_output(table, context)",
            where=one.where,
            action="give the module of an output: see calib/station/outputs/output.py",
        )
    return module


def available() -> list[str]:
    """The outputs that come with the station."""
    return sorted(file.parent.name for file in Path(__file__).parent.glob("*/output.py"))


def _own(name: str) -> str:
    return f"{PACKAGE}.{name}.output"
