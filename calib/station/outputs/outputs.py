"""All outputs together, as the loop sees them: one call for all, and none of them can end it."""

from collections.abc import Sequence

from calib.geodesy import Origin
from calib.station.core.outgoing import OutgoingTarget
from calib.station.core.station import UNASKED_HZ
from calib.station.outputs.output import CommandHandler, Output, StationStanding
from calib.station.status.status import EndpointStatus
from edge.common.health import Check, HealthLevel


class Outputs:
    """The outputs that are open, in the configuration's order."""

    def __init__(self, outputs: Sequence[Output]) -> None:
        self._outputs = tuple(outputs)

    @property
    def rate_hz(self) -> float:
        """The fastest rate at which any of them wants a target."""
        return max((output.rate_hz for output in self._outputs), default=UNASKED_HZ)

    def targets(self, targets: Sequence[OutgoingTarget], now_ns: int, synced: bool) -> None:
        """Send targets; and what else is due by now."""
        for output in self._outputs:
            output.targets(targets, now_ns, synced)

    def second(self, standing: StationStanding, texts: Sequence[tuple[HealthLevel, str]], now_ns: int) -> None:
        """Send what is sent every second, and words."""
        for output in self._outputs:
            output.second(standing, texts, now_ns)

    def moved(self, origin: Origin) -> None:
        """A network about another origin is in force."""
        for output in self._outputs:
            output.moved(origin)

    def calibrated(self, done: bool, now_ns: int) -> None:
        """A calibration has ended."""
        for output in self._outputs:
            output.calibrated(done, now_ns)

    def receive(self, now_ns: int, now_unix_ns: int, command: CommandHandler) -> None:
        """Take what came from outside, and answer."""
        for output in self._outputs:
            output.receive(now_ns, now_unix_ns, command)

    def checks(self, now_ns: int) -> list[Check]:
        """How all of them are."""
        return [check for output in self._outputs for check in output.checks(now_ns)]

    @property
    def counters(self) -> dict[str, float]:
        """What all of them counted."""
        return {name: value for output in self._outputs for name, value in output.counters.items()}

    @property
    def status(self) -> list[EndpointStatus]:
        """How each receiver is."""
        return [status for output in self._outputs for status in output.status]
