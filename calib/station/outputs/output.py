"""What an output is: one way in which targets leave the station. MAVLink is the first; each has a folder of its own.

The hazard is a protocol that has grown into the loop: its words, its masks and its pace in nine files, so that the next
one is surgery. So an output is given what every output is given, in the station's own words, and makes its protocol of
it by itself. It is opened by a function `open_output(table, context)` in the module that the configuration names.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from calib.geodesy import Origin
from calib.station.config import SiteSection
from calib.station.core.calibration import Phase
from calib.station.core.outgoing import OutgoingTarget
from calib.station.status.status import EndpointStatus
from edge.common.health import Check, HealthLevel

# A command from outside, e.g. "calibrate" -> whether it can be done now.
CommandHandler = Callable[[str], bool]


@dataclass(frozen=True)
class OutputContext:
    """What an output is opened with. where: its place in the configuration, for errors.

    folder: what relative paths are relative to. epoch: this start's number. signing_ticks: the signing time that was
    stored before this start. record: puts (endpoint, frame sent) into the recording. keep_signing_ticks: has a signing
    time survive a restart.
    """

    where: str
    site: SiteSection
    folder: Path
    epoch: int
    signing_ticks: int
    record: Callable[[str, bytes], None]
    keep_signing_ticks: Callable[[int], None]


@dataclass(frozen=True)
class CameraStanding:
    """One camera, as an output may tell of it. synced: its UTC is good. calibrated: its rays are used."""

    id: str
    online: bool
    synced: bool
    calibrated: bool


@dataclass(frozen=True)
class StationStanding:
    """How the station is, once a second.

    fault: why the station itself can't do its work, whatever the cameras do; empty if it can. cameras: in the
    configuration's order. latency_ms: exposure to sent, 95th percentile; None if unknown.
    """

    t_unix_ns: int
    uptime_ms: int
    phase: Phase
    reason: str
    action: str
    fault: str
    cameras: tuple[CameraStanding, ...]
    latency_ms: float | None
    confirmed: int
    tentative: int


class Output(Protocol):
    """One way out. Everything is called by one thread; now_ns: UTC by a clock that never steps.

    What a call raises ends that call alone: it is counted, and named among the station's checks.
    """

    @property
    def rate_hz(self) -> float:
        """The fastest rate at which any of its receivers wants a target."""

    def targets(self, targets: Sequence[OutgoingTarget], now_ns: int, synced: bool) -> None:
        """Send targets that moved, coast or are lost. Called often, also with none: for what is due by time.

        synced: whether the cameras' UTC is good.
        """

    def second(self, standing: StationStanding, texts: Sequence[tuple[HealthLevel, str]], now_ns: int) -> None:
        """Send what is sent every second. texts: what changed, in sentences."""

    def moved(self, origin: Origin) -> None:
        """A network about another origin is in force."""

    def calibrated(self, done: bool, now_ns: int) -> None:
        """A calibration has ended; whoever asked for it wants to know how."""

    def receive(self, now_ns: int, now_unix_ns: int, command: CommandHandler) -> None:
        """Take what came from outside. now_unix_ns: the data's now."""

    def wait(self, timeout_s: float) -> None:
        """Until something came, the network's word on what was sent say, or the time is over. Not for the loop."""

    def checks(self, now_ns: int) -> list[Check]:
        """How it is, once a second."""

    @property
    def counters(self) -> dict[str, float]:
        """What it counted, by names of its own; every number only grows."""

    @property
    def status(self) -> list[EndpointStatus]:
        """How each of its receivers is."""

    def close(self) -> None:
        """Let go of everything it opened."""
