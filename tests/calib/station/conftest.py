"""A station fed with a seeded scene, with the solver's answer taken from the scene itself."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from calib.network import Network
from calib.station.config import CalibrationSection
from calib.station.core.calibration import reduced
from calib.station.core.jobs import Solved, SolveResult
from calib.station.core.outgoing import OutgoingTarget
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from tools.doubles import core_station
from tools.doubles.box_messages import Sent, messages
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, make

Answer = Callable[[Network], Solved]
Change = Callable[[Sent], Iterator[Sent]]


def _good(network: Network) -> Solved:
    return Solved(network, 0.1)


@dataclass
class Fed:
    """A station and what came out of it: (seconds, target), (seconds, sentence), and the states it went through."""

    station: Station
    scene: Scene
    sent: list[tuple[float, OutgoingTarget]] = field(default_factory=list)
    said: list[tuple[float, str]] = field(default_factory=list)
    phases: list[tuple[float, str]] = field(default_factory=list)
    solves: bool = True
    answer: Answer = _good

    def take(self, message: Sent) -> None:
        """One message, and what is due at its arrival."""
        at_s = (message.arrival_ns - T0_UNIX_NS) * 1e-9
        self.sent += [
            (at_s, target) for target in self.station.handle(message.key, message.payload, message.arrival_ns)
        ]
        self.tick(message.arrival_ns)

    def tick(self, now_ns: int) -> None:
        """Let time pass."""
        at_s = (now_ns - T0_UNIX_NS) * 1e-9
        tick = self.station.tick(now_ns)
        self.sent += [(at_s, target) for target in tick.targets]
        self.said += [(at_s, text) for _, text in tick.texts]
        if tick.job is not None and self.solves:
            known = {camera.id for camera in tick.job.scene.cameras}
            network = reduced(self.scene.network, known)
            self.station.solved(SolveResult(tick.job.number, self.answer(network), None, 1.0))
        phase = self.station.standing.phase.value
        if not self.phases or self.phases[-1][1] != phase:
            self.phases.append((at_s, phase))

    def errors_m(self, after_s: float = 0.0) -> np.ndarray:
        """Distance of every confirmed target sent to the nearest true object."""
        return np.array(
            [
                np.linalg.norm(self.scene.positions(target.t_unix_ns) - target.position_enu, axis=1).min()
                for at_s, target in self.sent
                if at_s > after_s and target.state == "confirmed"
            ]
        )


def station_for(scene: Scene, memory: StoredState | None = None) -> Station:
    """A station configured for a scene, that asks for a solve soon."""
    return core_station.station_for(scene, memory, CalibrationSection(first_solve_s=3.0))


@pytest.fixture
def feed() -> Callable[..., Fed]:
    """Feed a station with a scene, each message changed on its way: `feed(Spec(...), change)`."""

    def run(
        spec: Spec,
        change: Change | None = None,
        memory: StoredState | None = None,
        *,
        solves: bool = True,
        answer: Answer = _good,
    ) -> Fed:
        scene = make(spec)
        fed = Fed(station_for(scene, memory), scene, solves=solves, answer=answer)
        for message in messages(scene):
            for changed in change(message) if change is not None else (message,):
                fed.take(changed)
        return fed

    return run
