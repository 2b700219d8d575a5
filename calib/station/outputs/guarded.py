"""An output that can't take the others with it: what it raises is counted and named, and ends that call alone.

The hazard is a fault in one protocol, perhaps one that somebody else wrote, which silences all of them: the aircraft
vanishes from every map because a text had a letter that one format can't carry.
"""

from collections.abc import Sequence
from typing import Final

from calib.geodesy import Origin
from calib.station.core.outgoing import OutgoingTarget
from calib.station.fence import Fence
from calib.station.outputs.output import CommandHandler, Output, StationStanding
from calib.station.status.status import EndpointStatus
from edge.common.health import Check, HealthLevel

ACTION: Final = "its log says where; correct its table in the configuration, or report it to whoever wrote it"


class GuardedOutput:
    """An `Output` round another one."""

    def __init__(self, name: str, inner: Output) -> None:
        self.name = name
        self._inner = inner
        self._fence = Fence(f"output {name}", "warn", ACTION)
        self.rate_hz = inner.rate_hz

    def targets(self, targets: Sequence[OutgoingTarget], now_ns: int, synced: bool) -> None:
        """Hand on targets."""
        with self._fence:
            self._inner.targets(targets, now_ns, synced)

    def second(self, standing: StationStanding, texts: Sequence[tuple[HealthLevel, str]], now_ns: int) -> None:
        """Hand on how the station is."""
        with self._fence:
            self._inner.second(standing, texts, now_ns)

    def moved(self, origin: Origin) -> None:
        """Hand on another origin."""
        with self._fence:
            self._inner.moved(origin)

    def calibrated(self, done: bool, now_ns: int) -> None:
        """Hand on how a calibration ended."""
        with self._fence:
            self._inner.calibrated(done, now_ns)

    def receive(self, now_ns: int, now_unix_ns: int, command: CommandHandler) -> None:
        """Have it take what came."""
        with self._fence:
            self._inner.receive(now_ns, now_unix_ns, command)

    def wait(self, timeout_s: float) -> None:
        """Until something came for it, or the time is over."""
        with self._fence:
            self._inner.wait(timeout_s)

    def checks(self, now_ns: int) -> list[Check]:
        """Its own, and that it failed lately."""
        found: list[Check] = []
        with self._fence:
            found = self._inner.checks(now_ns)
        return found + self._fence.checks(now_ns)

    @property
    def counters(self) -> dict[str, float]:
        """Its own, and the calls that failed."""
        found: dict[str, float] = {}
        with self._fence:
            found = {f"{self.name}_{name}": value for name, value in self._inner.counters.items()}
        return found | {f"{self.name}_failed_calls": float(self._fence.count)}

    @property
    def status(self) -> list[EndpointStatus]:
        """How each of its receivers is."""
        with self._fence:
            return self._inner.status
        return []

    def close(self) -> None:
        """Close it."""
        with self._fence:
            self._inner.close()
