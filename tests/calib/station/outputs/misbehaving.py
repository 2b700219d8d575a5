"""Outputs as nobody should write them: one that raises at every call, one that does not come back."""

import threading
import time
from collections.abc import Sequence
from typing import Any

from calib.geodesy import Origin
from calib.station.core.outgoing import OutgoingTarget
from calib.station.outputs.output import CommandHandler, OutputContext, StationStanding
from calib.station.status.status import EndpointStatus
from edge.common.health import Check, HealthLevel


def open_output(table: dict[str, Any], context: OutputContext) -> "Misbehaving":
    return Misbehaving(**table)


class Misbehaving:
    """how: "raises", "hangs" until it is closed, or "sleeps" once for `seconds`; else it counts what it is given."""

    rate_hz = 50.0

    def __init__(self, how: str = "", seconds: float = 0.0) -> None:
        self.how, self.seconds = how, seconds
        self.calls: list[str] = []
        self.origins: list[Origin] = []
        self.commands: list[str] = []
        self.answers: list[bool] = []
        self.threads: set[str] = set()
        self.free = threading.Event()

    def _called(self, name: str) -> None:
        self.calls.append(name)
        self.threads.add(threading.current_thread().name)
        if self.how == "raises":
            raise KeyError(name)
        if self.how == "hangs":
            self.free.wait(20.0)
        elif self.how == "sleeps":
            self.how = ""
            time.sleep(self.seconds)

    def targets(self, targets: Sequence[OutgoingTarget], now_ns: int, synced: bool) -> None:
        if targets or self.how == "raises":
            self._called("targets")

    def second(self, standing: StationStanding, texts: Sequence[tuple[HealthLevel, str]], now_ns: int) -> None:
        self._called("second")

    def moved(self, origin: Origin) -> None:
        self.origins.append(origin)

    def calibrated(self, done: bool, now_ns: int) -> None:
        self._called("calibrated")

    def receive(self, now_ns: int, now_unix_ns: int, command: CommandHandler) -> None:
        while self.commands:
            self.answers.append(command(self.commands.pop()))

    def wait(self, timeout_s: float) -> None:
        self._called("wait")

    def checks(self, now_ns: int) -> list[Check]:
        return [Check("misbehaving", "ok", f"{len(self.calls)} calls")]

    @property
    def counters(self) -> dict[str, float]:
        return {"calls": float(len(self.calls))}

    @property
    def status(self) -> list[EndpointStatus]:
        return []

    def close(self) -> None:
        self.calls.append("close")
