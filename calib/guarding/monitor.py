"""Has a camera been knocked, has its clock stepped, is its picture frozen? From raw rays against the network.

The hazard is a guard that trusts what it guards. A filter bends its target towards a camera that was knocked, and a
watch on the filter's residuals falls asleep; so no target estimate enters here. Two cameras whose raw rays meet for a
second are witnesses to a point; a third that should see it, and reports a track close by but not there, has a residual.
The camera with the strongest evidence of a fault is named, one at a time: as a witness it spoils the others' residuals.
"""

from collections import defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from calib.guarding.diagnosis import FaultEvidence, Residual, diagnose
from calib.guarding.meetings import Meetings, attitude_sigma, median_low, meetings
from calib.guarding.raytracks import RayTrack, RayTracks
from calib.network import Network
from calib.observations import Frame
from calib.sighting import CameraView

ROUND_NS: Final = 200_000_000  # between rounds, each of one pair of witnesses: a twentieth of a core at most
DONE: Final = object()  # what a round that is over gives
CHECKED_A_ROUND: Final = 6  # cameras that a pair is compared with at once, for the same reason
WATCHED_NS: Final = 1_000_000_000  # of rays looked at: longer, and an old pose speaks with the new
LEAST_INSTANTS: Final = 3  # instants that the witnesses' point and the third camera's track must both have
INSIDE_BY_PX: Final = 5.0
ALL_PAIRS_UP_TO: Final = 10  # cameras; beyond, each is a witness with its next three in the network
NEAR_RAD: Final = 0.05  # 2.9 degrees: what is farther from where it should be is another object
FROZEN_S: Final = 3.0  # s of identical detections; a hovering drone's jitter in the last digit
FROZEN_FRAMES: Final = 30
DISCIPLINED_SIGMA_S: Final = 0.002  # of a clock held by chrony over a local network
AGREE_PAIRS: Final = 2  # of cameras whose rays meet, at least, before a stored network is accepted
AGREE_SHARE: Final = 0.5  # of the pairs that saw something at the same time
AGREE_TIMES: Final = 3  # in a row
AGREE_EVERY_NS: Final = 300_000_000
REFUSE_NS: Final = 6_000_000_000  # of rays that do not meet, after which it is refused


@dataclass(frozen=True)
class Finding:
    """A camera at fault, why, and since when its observations are not to be used."""

    camera: str
    reason: str
    since_unix_ns: int


@dataclass
class _Candidate:
    """A stored network on trial: since when rays could have met, when last looked, how often in a row most met."""

    network: Network
    since_ns: int = 0
    asked_ns: int = 0
    agreed: int = 0


class Guard:
    """Watches all cameras of the network in force; or says whether a stored network agrees with what is seen."""

    def __init__(self) -> None:
        self._tracks = RayTracks()
        self._network: Network | None = None
        self._ignored: set[str] = set()
        self._views: dict[str, CameraView] = {}
        self._since: dict[str, int] = {}
        self._residuals: defaultdict[str, deque[Residual]] = defaultdict(lambda: deque(maxlen=400))
        self._turn = 0
        self._round: Iterator[None] | None = None  # under way, a piece at a time
        self._round_ns = 0
        self._now_unix_ns = 0
        self._found: list[Finding] = []
        self._frozen: dict[str, tuple[bytes, int, int]] = {}  # pixels, since, frames
        self._candidate: _Candidate | None = None
        self.clock_sigma_s: dict[str, float] = {}  # how well each camera keeps time; who is not in it is disciplined
        self.residual_mrad: dict[tuple[str, str], float] = {}

    def trust(self, network: Network) -> None:
        """Watch this network from now on."""
        self.forget()
        self._network = network
        self._views = {camera.id: CameraView.of(camera) for camera in network.cameras}

    def forget(self) -> None:
        """There is no network any more."""
        self._network, self._candidate, self._round = None, None, None
        self._found.clear()
        self._ignored.clear()
        self._residuals.clear()
        self.residual_mrad.clear()

    def ignore(self, camera: str) -> None:
        """This camera has been left out; it is neither a witness nor compared."""
        self._ignored.add(camera)
        self._round = None
        self._residuals.clear()  # residuals against it as a witness were false

    def observe(self, frame: Frame) -> None:
        """Take a frame of any camera."""
        self._tracks.add(frame)
        pixels = frame.pixels.tobytes()
        same, since, frames = self._frozen.get(frame.camera, (b"", frame.t_unix_ns, 0))
        still = pixels == same and len(frame.pixels) > 0
        self._frozen[frame.camera] = (pixels, since, frames + 1) if still else (pixels, frame.t_unix_ns, 0)

    # Watching

    def findings(self, now_unix_ns: int) -> list[Finding]:
        """Which cameras are at fault now; a round that is not done by now is finished, and the next begun."""
        found = [
            Finding(camera, "its picture is frozen", since)
            for camera, (_, since, frames) in self._frozen.items()
            if frames >= FROZEN_FRAMES and now_unix_ns - since > FROZEN_S * 1e9
        ]
        if abs(now_unix_ns - self._round_ns) >= ROUND_NS:
            while self._round is not None:
                self.work(now_unix_ns)
            self._round, self._round_ns = self._one_round(), now_unix_ns
        found += self._found
        self._found = []
        return found

    def work(self, now_unix_ns: int) -> None:
        """Do one piece of the round, of a millisecond or two: done at once, the loop would keep positions waiting."""
        self._now_unix_ns = now_unix_ns
        if self._round is not None and next(self._round, DONE) is DONE:
            self._round = None

    def _one_round(self) -> Iterator[None]:
        """A round: one pair of witnesses meets, each other camera is compared, and all residuals are diagnosed."""
        network = self._network
        pairs = [] if network is None else self._witnesses([c.id for c in network.cameras if c.id not in self._ignored])
        if network is None or not pairs:
            return
        yield from self._check_others(network, *pairs[self._turn % len(pairs)])
        self._turn += 1
        yield from self._decide()

    @staticmethod
    def _witnesses(cameras: list[str]) -> list[tuple[str, str]]:
        if len(cameras) <= ALL_PAIRS_UP_TO:
            return list(combinations(cameras, 2))
        return [(cameras[k], cameras[(k + n) % len(cameras)]) for k in range(len(cameras)) for n in (1, 2, 3)]

    def _check_others(self, network: Network, one: str, other: str) -> Iterator[None]:
        since_ns = self._now_unix_ns - WATCHED_NS
        met, _ = meetings(network, (one, other), self._tracks, since_ns)
        if met is None:
            return
        self.residual_mrad[one, other] = met.miss_rad * 1e3
        others = [c.id for c in network.cameras if c.id not in {one, other} | self._ignored]
        for k in range(min(CHECKED_A_ROUND, len(others))):
            yield
            camera = others[(self._turn + k) % len(others)]
            tracks = self._tracks.of(network.camera(camera), network, since_ns)
            self._residuals_of(network, camera, met, tracks, self._now_unix_ns)

    def _residuals_of(
        self, network: Network, camera_id: str, met: Meetings, tracks: list[RayTrack], now_unix_ns: int
    ) -> None:
        view = self._views[camera_id]
        shape = met.points.shape[:2]
        seen = view.sight(met.points.reshape(-1, 3))
        due = (seen.valid & view.inside(seen.pixels, INSIDE_BY_PX)).reshape(shape).all(axis=1)
        if not tracks or not due.any():
            return
        off = np.stack([track.at(met.t_s.ravel()) for track in tracks]) - seen.pixels
        off = off.reshape(len(tracks), *shape, 2)
        enough = np.isfinite(off[..., 0]).sum(axis=2) >= LEAST_INSTANTS
        median = median_low(np.moveaxis(off, 2, 3))
        miss_px = np.where(enough & due, np.linalg.norm(median, axis=2), np.inf)
        nearest = np.argmin(miss_px, axis=0)
        focal = min(view.camera.lens.intrinsics[:2])
        range_m = np.linalg.norm(met.points - view.camera.centre_enu, axis=2)
        near = focal / median_low(range_m)
        noise_px = np.hypot(met.noise_px, near * median_low(met.noise_m))
        expected_px = np.hypot(focal * attitude_sigma(network, camera_id), near * median_low(met.expected_m))
        pixels = seen.pixels.reshape(*shape, 2)
        for m, n in enumerate(nearest):
            if miss_px[n, m] < NEAR_RAD * focal:
                velocity = (pixels[m, -1] - pixels[m, 0]) / max(float(met.t_s[m, -1] - met.t_s[m, 0]), 1e-3)
                residual = Residual(now_unix_ns, median[n, m], velocity, float(noise_px[m]), float(expected_px[m]))
                self._residuals[camera_id].append(residual)

    def _decide(self) -> Iterator[None]:
        """At most one camera a round: the others' residuals are taken afresh without it."""
        faulty: list[tuple[float, str, FaultEvidence]] = []
        for camera in list(self._residuals):
            yield
            sigma_s = self.clock_sigma_s.get(camera, DISCIPLINED_SIGMA_S)
            fault = diagnose(self._residuals[camera], self._now_unix_ns, sigma_s)
            if fault is not None:
                faulty.append((fault.strength, camera, fault))
        if faulty:
            _, camera, fault = max(faulty, key=lambda entry: entry[:2])
            since_unix_ns = fault.since_unix_ns - WATCHED_NS
            self._found = [Finding(camera, self._reason(camera, fault), since_unix_ns)]

    def _reason(self, camera: str, fault: FaultEvidence) -> str:
        if fault.clock_s is not None:
            return f"its clock has stepped by about {-fault.clock_s * 1e3:.0f} ms"
        focal = min(self._views[camera].camera.lens.intrinsics[:2])
        return f"it was knocked: its rays miss by {np.degrees((fault.knock_px or 0.0) / focal):.2f} degrees"

    # A stored network

    def agrees(self, network: Network, now_unix_ns: int) -> bool | None:
        """Whether rays meet as this network says: True or False once that is clear, None until then."""
        if self._candidate is None or self._candidate.network is not network:
            self._candidate = _Candidate(network)
        candidate = self._candidate
        if abs(now_unix_ns - candidate.asked_ns) < AGREE_EVERY_NS:
            return None
        candidate.asked_ns = now_unix_ns
        pairs = self._witnesses([camera.id for camera in network.cameras])
        looked = [meetings(network, pair, self._tracks, now_unix_ns - WATCHED_NS) for pair in pairs]
        met, could = sum(found is not None for found, _ in looked), sum(possible for _, possible in looked)
        if could < AGREE_PAIRS:
            return None
        candidate.since_ns = candidate.since_ns or now_unix_ns
        # By chance two rays meet now and then; most pairs at once, again and again, only if the network is right.
        candidate.agreed = candidate.agreed + 1 if met >= max(AGREE_PAIRS, AGREE_SHARE * could) else 0
        verdict = True if candidate.agreed >= AGREE_TIMES else None
        if verdict is None and now_unix_ns - candidate.since_ns > REFUSE_NS:
            verdict = False
        if verdict is not None:
            self._candidate = None
        return verdict
