"""A site with one camera that lies, in virtual time and with the real solver: what is sent, and who is named."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from calib.errors import CalibrationError
from calib.scoring.consistency import CHI2_3_999
from calib.station.core.jobs import SolveJob, SolveResult
from calib.station.core.outgoing import OutgoingTarget
from calib.station.live_solver import LiveSolver
from edge.common.units import NS
from tools.doubles.box_messages import messages
from tools.doubles.core_station import station_for
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, make
from tools.doubles.liars import LIAR, Liar, Lie

FLIGHT_S: Final = 75.0
SOLVED_AFTER_S: Final = 2.0  # of virtual time: what a solve takes on a laptop
SOON_S: Final = 5.0  # of the lie, before positions count


@dataclass
class Outcome:
    """What came of one lie. errors in metres, nees of each position sent, from SOON_S of the lie on."""

    lie: str
    cameras: int
    seed: int
    errors_m: list[float]
    sigmas_m: list[float]
    nees: list[float]
    whole: list[float] = field(default_factory=list)  # those of nees that were sent without a mark
    named: dict[str, float] | None = None  # camera: seconds of the lie
    said: str = ""  # how the station stood at the end

    @property
    def beyond(self) -> float:
        """Share of positions that lie outside what they claim."""
        return float(np.mean(np.array(self.nees) > CHI2_3_999)) if self.nees else 0.0

    @property
    def beyond_whole(self) -> float:
        """The same of what was sent as whole: verified by three cameras, and not degraded."""
        return float(np.mean(np.array(self.whole) > CHI2_3_999)) if self.whole else 0.0

    @property
    def innocents(self) -> list[str]:
        """Honest cameras that were named."""
        return [camera for camera in self.named or {} if camera != LIAR]


def run(lie: Lie, cameras: int, seed: int, flight_s: float = FLIGHT_S) -> Outcome:
    """One site with one liar, from its start."""
    scene = make(Spec(cameras=cameras, uavs=2, duration_s=flight_s, rate_hz=10.0, noise_px=1.0, seed=seed))
    out = Outcome(lie.name, cameras, seed, [], [], [], named={})
    site = _Site(scene, lie, out)
    liar = Liar(lie)
    for sent in messages(scene):
        for told in liar(sent):
            site.hear(told.key, told.payload, told.arrival_ns)
    standing = site.station.standing
    out.said = f"{standing.phase}: {standing.reason}"
    return out


class _Site:
    """A station in virtual time, its solver in this process."""

    def __init__(self, scene: Scene, lie: Lie, out: Outcome) -> None:
        self.station = station_for(scene)
        self._scene, self._lie, self._out = scene, lie, out
        self._solver = LiveSolver()
        self._due: tuple[int, SolveResult] | None = None

    def hear(self, key: str, payload: bytes, now_ns: int) -> None:
        """One message, and what is due by then."""
        targets = self.station.handle(key, payload, now_ns)
        tick = self.station.tick(now_ns)
        if self._due is not None and now_ns >= self._due[0]:
            self.station.solved(self._due[1])
            self._due = None
        if tick.job is not None:
            self._due = now_ns + round(SOLVED_AFTER_S * NS), self._solve(tick.job)
        told_s = (now_ns - T0_UNIX_NS) / NS - self._lie.since_s
        for camera in self.station.calibration.suspects:
            assert self._out.named is not None
            self._out.named.setdefault(camera, told_s)
        if told_s > SOON_S:
            for target in targets + tick.targets:
                self._score(target)

    def _solve(self, job: SolveJob) -> SolveResult:
        try:
            return SolveResult(job.number, self._solver(job.scene, job.start), None, SOLVED_AFTER_S)
        except CalibrationError as error:
            return SolveResult(job.number, None, error, SOLVED_AFTER_S)

    def _score(self, target: OutgoingTarget) -> None:
        if target.state != "confirmed":
            return
        off = self._scene.positions(target.t_unix_ns) - target.position_enu
        error = off[np.argmin(np.linalg.norm(off, axis=1))]
        self._out.errors_m.append(float(np.linalg.norm(error)))
        self._out.sigmas_m.append(float(np.sqrt(np.trace(target.position_covariance_enu))))
        self._out.nees.append(float(error @ np.linalg.solve(target.position_covariance_enu, error)))
        if target.verified and not target.degraded:
            self._out.whole.append(self._out.nees[-1])
