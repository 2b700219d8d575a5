"""Has a camera been knocked, has its clock stepped, is its picture frozen? From raw rays against the network.

The hazard is a guard that trusts what it guards. A filter bends its target towards a camera that was knocked, and a
watch on the filter's residuals falls asleep; so no target estimate enters here. And a guard that believes the knocked
camera as it believes the others names an innocent: a camera is named only where three others agree without it, beyond
doubt and by a margin; else the finding has no name, "these cameras disagree", and that too is an alarm.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from calib.guarding.boxshare import BoxShare
from calib.guarding.candidate import StoredTrial
from calib.guarding.diagnosis import Contradiction, ExpectedErrors, GuardVerdict, judge, supports
from calib.guarding.evidence import FAULT_SIZE, evidence
from calib.guarding.looks import INSTANTS_APART_S, CameraLook, Expectations, attitudes_rad, look
from calib.guarding.meetings import meetings
from calib.guarding.memory import EvidenceMemory, Slice
from calib.guarding.objects import Grouping
from calib.guarding.raytracks import RayTracks
from calib.guarding.sums import Remembered, summed
from calib.guarding.wander import ClockEstimate, ClockWander
from calib.network import POSE_SIZE, Network
from calib.observations import Frame
from calib.sighting import CameraView
from edge.common.arrays import Array

SLICE_NS: Final = 500_000_000  # of rays that are compared at once, and time between two rounds
INSTANTS: Final = 5  # of a slice, INSTANTS_APART_S apart
DONE: Final = object()  # what a round that is over gives
WATCHED_NS: Final = 1_000_000_000  # of rays looked at: longer, and an old pose speaks with the new
WAITED_NS: Final = 1_000_000_000  # for the slowest camera; one that is farther behind is not compared
WINDOWS_NS: Final = (1_000_000_000, 2_000_000_000, 4_000_000_000, 6_000_000_000)  # evidence looked back on
CHANGES_NS: Final = tuple(SLICE_NS * n for n in (2, 3, 4, 5, 6, 8, 10, 12))  # ago: when something may have changed
APART_NS: Final = SLICE_NS // 2  # before a change: the slice that ended then may be of both times
BEFORE_NS: Final = 4_000_000_000  # of rays from before a change, that it is compared with
FEWEST_SLICES: Final = 2
NAMED_ROUNDS: Final = 2  # in a row that name the same camera, before it is named
UNNAMED_ROUNDS: Final = 3  # in a row that contradict, where no camera can be named
NAMEABLE_ROUNDS: Final = 7  # the same where one might still be: four cameras see the same objects
NAMEABLE: Final = 4  # cameras
MOST_OBJECTS: Final = 6  # a slice: more say little more, and cost
ALL_PAIRS_UP_TO: Final = 10  # cameras; beyond, each is paired with its next three in the network
CALM: Final = 10.0  # taken off the sum of squares: more may be a fault that grows, and is not learnt from
TINY: Final = 1e-14  # rad^2, m^2, s^2: an error known to be exactly none has no inverse
FROZEN_S: Final = 3.0  # s of identical detections; a hovering drone's jitter in the last digit
FROZEN_FRAMES: Final = 30
DISCIPLINED_SIGMA_S: Final = 0.002  # of a clock held by chrony over a local network


@dataclass(frozen=True)
class Finding:
    """A fault, why, and since when the observations are not to be used.

    camera: the one at fault, or None: the cameras of `among` contradict each other, and which is wrong cannot be told.
    miss_rad: by how much what it shows is off.
    """

    camera: str | None
    reason: str
    since_unix_ns: int
    among: tuple[str, ...] = ()
    miss_rad: float = 0.0


@dataclass(frozen=True)
class Disagreement:
    """Rays contradict each other now: if it is this camera, by miss_rad. The best guess, and no more."""

    camera: str
    miss_rad: float


class Guard:
    """Watches all cameras of the network in force; or says whether a stored network agrees with what is seen."""

    def __init__(self) -> None:
        self._tracks = RayTracks()
        self._network: Network | None = None
        self._ignored: set[str] = set()
        self._views: dict[str, CameraView] = {}
        self._covariance: Array = np.empty((0, 0))
        self._memory = EvidenceMemory(WINDOWS_NS[-1], BEFORE_NS)
        self._share = BoxShare()
        self._turn = 0
        self._round: Iterator[None] | None = None  # under way, a piece at a time
        self._round_ns = 0
        self._now_unix_ns = 0
        self._sliced_ns = 0
        self._wander = ClockWander()
        self._suspected: list[str | None] = []  # of the last rounds in a row that contradict: who, if anybody
        self._doubt: Disagreement | None = None
        self._found: list[Finding] = []
        self._frozen: dict[str, tuple[bytes, int, int]] = {}  # pixels, since, frames
        self._candidate: StoredTrial | None = None
        self._clock_bound_s: dict[str, float | None] = {}  # as each camera states it of its own clock
        self.residual_mrad: dict[tuple[str, str], float] = {}

    def trust(self, network: Network) -> None:
        """Watch this network from now on."""
        self.forget()
        self._network = network
        self._views = {camera.id: CameraView.of(camera) for camera in network.cameras}
        self._covariance = _with_room_for_clocks(network)

    def forget(self) -> None:
        """There is no network any more."""
        self._network, self._candidate = None, None
        self._found.clear()
        self._ignored.clear()
        self._begin_anew()
        self.residual_mrad.clear()

    def ignore(self, camera: str) -> None:
        """This camera has been left out; it is neither a witness nor compared. What the others showed stays."""
        if camera in self._ignored:
            return
        self._ignored.add(camera)
        self._round = None
        self._suspected.clear()
        if self._network is not None and camera in self._views:
            self._memory.without([one.id for one in self._network.cameras].index(camera))

    def _begin_anew(self) -> None:
        """Nothing that was seen until now says anything of what comes."""
        self._round = None
        self._memory.clear()
        self._wander.clear()
        self._suspected.clear()

    def state_clock(self, camera: str, bound_s: float | None) -> None:
        """What a camera states of its own clock: by how much at most it is off UTC; None: nothing."""
        self._clock_bound_s[camera] = bound_s

    @property
    def doubt(self) -> Disagreement | None:
        """What is wrong if anything is, while rays contradict each other and nothing has been found yet."""
        return self._doubt if self._suspected else None

    def observe(self, frame: Frame) -> None:
        """Take a frame of any camera."""
        self._tracks.add(frame)
        pixels = frame.pixels.tobytes()
        same, since, frames = self._frozen.get(frame.camera, (b"", frame.t_unix_ns, 0))
        still = pixels == same and len(frame.pixels) > 0
        self._frozen[frame.camera] = (pixels, since, frames + 1) if still else (pixels, frame.t_unix_ns, 0)

    # Watching

    def findings(self, now_unix_ns: int) -> list[Finding]:
        """What is at fault now; a round that is not done by now is finished, and the next begun."""
        found = [
            Finding(camera, "its picture is frozen", since)
            for camera, (_, since, frames) in self._frozen.items()
            if frames >= FROZEN_FRAMES and now_unix_ns - since > FROZEN_S * 1e9
        ]
        if abs(now_unix_ns - self._round_ns) >= SLICE_NS:
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
        """A slice of rays becomes evidence, and all evidence of the last seconds is judged."""
        network = self._network
        end_ns = self._slice_end_ns()
        if network is None or end_ns is None:
            return
        self._sliced_ns = end_ns
        yield from self._measure_a_pair(network)
        looks: list[CameraLook] = []
        for view in self._watched():
            looks.append(self._look(network, view, end_ns))
            yield
        grouping = Grouping(looks, self._pairs(len(looks)))
        yield from grouping.steps()
        numbers = [network.cameras.index(one.view.camera) for one in looks]
        found = []
        for seen in grouping.objects()[:MOST_OBJECTS]:
            one = evidence(looks, seen)
            found.append(replace(one, cameras=np.array([numbers[k] for k in one.cameras])))
            yield
        gone = self._memory.add(end_ns, found)
        yield from self._judge(network, end_ns, gone)

    def _slice_end_ns(self) -> int | None:
        """As far as all cameras have come that are not far behind, unless that is hardly farther than last time."""
        newest = [
            stamp
            for camera, stamp in self._tracks.newest_ns.items()
            if camera in self._views and camera not in self._ignored and self._now_unix_ns - stamp < WAITED_NS
        ]
        if len(newest) < 2:
            return None
        end_ns = min(newest)
        if end_ns < self._sliced_ns - WAITED_NS:  # time went back
            self._begin_anew()
            return end_ns
        return end_ns if end_ns >= self._sliced_ns + SLICE_NS * 3 // 4 else None

    def _watched(self) -> list[CameraView]:
        return [view for camera, view in self._views.items() if camera not in self._ignored]

    def _look(self, network: Network, view: CameraView, end_ns: int) -> CameraLook:
        tracks = self._tracks.of(view.camera, network, end_ns - WATCHED_NS)
        t_s: Array = network.since_mid_s(end_ns) - INSTANTS_APART_S * (np.arange(INSTANTS, 0, -1, dtype=float) - 0.5)
        clocks = self._expected_clocks(network, end_ns)
        clocks_s = {camera.id: float(one) for camera, one in zip(network.cameras, clocks.sigma_s, strict=True)}
        return look(
            view, tracks, t_s, Expectations(network.rms_px, self._share.sigma, attitudes_rad(network), clocks_s)
        )

    def _expected_clocks(self, network: Network, end_ns: int) -> ClockEstimate:
        """What a clock may be off by: half of what it states, for a bound is the largest error; or its own past.

        The lesser of the two: by stating that it may be off by a second, nobody is forgiven more than by silence.
        """
        stated = [self._clock_bound_s.get(camera.id) for camera in network.cameras]
        wander = self._wander.expected(end_ns, len(stated))
        sigma_s = np.array([np.inf if one is None else max(one / 2, DISCIPLINED_SIGMA_S) for one in stated])
        by_past = wander.sigma_s < sigma_s
        return ClockEstimate(np.where(by_past, wander.off_s, 0.0), np.where(by_past, wander.sigma_s, sigma_s))

    @staticmethod
    def _pairs(cameras: int) -> list[tuple[int, int]]:
        if cameras <= ALL_PAIRS_UP_TO:
            return list(combinations(range(cameras), 2))
        return [(k, (k + n) % cameras) for k in range(cameras) for n in (1, 2, 3)]

    def _measure_a_pair(self, network: Network) -> Iterator[None]:
        """How well rays of one pair meet, for whoever wants to see it."""
        names = [view.camera.id for view in self._watched()]
        pairs = [(names[a], names[b]) for a, b in self._pairs(len(names))]
        if not pairs:
            return
        pair = pairs[self._turn % len(pairs)]
        self._turn += 1
        met, _ = meetings(network, pair, self._tracks, self._now_unix_ns - WATCHED_NS)
        if met is not None:
            self.residual_mrad[pair] = met.miss_rad * 1e3
        yield

    # Judging

    def _judge(self, network: Network, end_ns: int, gone: list[Slice]) -> Iterator[None]:
        expected = self._expected(network, end_ns)
        verdicts: list[tuple[GuardVerdict, list[Slice]]] = []
        verdict: GuardVerdict | None = None
        for window_ns in WINDOWS_NS:
            slices = self._memory.since(end_ns - window_ns)
            if len(slices) < FEWEST_SLICES:
                continue
            verdict = judge(slices, summed(slices, len(network.cameras)), expected)
            if verdict.astray:
                verdicts.append((verdict, slices))
            yield
        if verdict is None:
            return
        remembered = Remembered(self._memory.since(0), len(network.cameras))
        yield from remembered.prepare()
        for ago_ns in CHANGES_NS:
            then_ns = end_ns - ago_ns
            slices = self._memory.since(then_ns)
            if min(len(slices), len(self._memory.until(then_ns - APART_NS))) < FEWEST_SLICES:
                continue
            changed = judge(slices, remembered.since(then_ns, APART_NS), expected, remembered.until(then_ns - APART_NS))
            if changed.astray:
                verdicts.append((changed, slices))
            yield
        if verdicts:
            verdict, slices = max(verdicts, key=lambda entry: entry[0].rank)
            self._suspect(network, verdict, slices)
            return
        self._suspected.clear()
        if verdict.worst.score > CALM:
            return
        self._wander.add(end_ns, verdict.clocks)
        for one in gone:
            for _, found in one.objects:
                self._share.learn(found)

    def _suspect(self, network: Network, verdict: GuardVerdict, slices: list[Slice]) -> None:
        name = network.cameras[verdict.worst.camera].id if verdict.named else None
        self._suspected.append(name)
        miss_rad = max(verdict.turned_rad, verdict.stepped_rad)
        self._doubt = Disagreement(network.cameras[verdict.worst.camera].id, miss_rad)
        named = name is not None and self._suspected[-NAMED_ROUNDS:] == [name] * NAMED_ROUNDS
        among = sorted({int(k) for one in slices for _, found in one.objects for k in found.cameras})
        rounds = UNNAMED_ROUNDS if len(among) < NAMEABLE else NAMEABLE_ROUNDS
        if not named and len(self._suspected) < rounds:
            return
        since_ns = self._since_ns(verdict.worst, len(network.cameras))
        if named:
            self._found = [Finding(name, _reason(verdict), since_ns, (), miss_rad)]
        else:
            names = tuple(network.cameras[k].id for k in among)
            reason = f"these cameras disagree: {', '.join(names)}"
            self._found = [Finding(None, reason, since_ns, names, miss_rad)]
        self._suspected.clear()

    def _since_ns(self, found: Contradiction, cameras: int) -> int:
        """The beginning of the first slice of those in a row that the change explains, and one more for the doubt."""
        since_ns = self._sliced_ns
        for one in reversed(self._memory.since(0)):
            if not supports(one, found, cameras):
                break
            since_ns = one.t_unix_ns
        return since_ns - 2 * SLICE_NS

    def _expected(self, network: Network, end_ns: int) -> ExpectedErrors:
        clocks = self._expected_clocks(network, end_ns)
        of_clocks = np.arange(len(network.cameras)) * FAULT_SIZE + POSE_SIZE
        covariance, mean = self._covariance.copy(), np.zeros(len(self._covariance))
        covariance[of_clocks, of_clocks], mean[of_clocks] = clocks.sigma_s**2, clocks.off_s
        focal_px = np.array([min(camera.lens.intrinsics[:2]) for camera in network.cameras], float)
        stated = [self._clock_bound_s.get(camera.id) for camera in network.cameras]
        bound_s = np.array([np.inf if one is None else max(one, DISCIPLINED_SIGMA_S) for one in stated], float)
        return ExpectedErrors(mean, np.asarray(np.linalg.inv(covariance), float), focal_px, bound_s)

    # A stored network

    def agrees(self, network: Network, now_unix_ns: int) -> bool | None:
        """Whether rays meet as this network says: True or False once that is clear, None until then."""
        if self._candidate is None or self._candidate.network is not network:
            self._candidate = StoredTrial(network)
        names = [camera.id for camera in network.cameras]
        pairs = [(names[a], names[b]) for a, b in self._pairs(len(names))]
        verdict = self._candidate.verdict(self._tracks, pairs, now_unix_ns, WATCHED_NS)
        if verdict is not None:
            self._candidate = None
        return verdict


def _with_room_for_clocks(network: Network) -> Array:
    """(7 C, 7 C) covariance of the poses, each camera's followed by its clock's, still zero."""
    count = len(network.cameras)
    of_pose = np.concatenate([k * FAULT_SIZE + np.arange(POSE_SIZE) for k in range(count)])
    covariance = np.zeros((count * FAULT_SIZE, count * FAULT_SIZE))
    covariance[np.ix_(of_pose, of_pose)] = network.covariance
    covariance[of_pose, of_pose] += TINY
    return covariance


def _reason(verdict: GuardVerdict) -> str:
    found = verdict.worst
    turned = f"{np.degrees(verdict.turned_rad):.2f} degrees"
    stepped = f"{-found.step_s * 1e3:.0f} ms"
    if found.cause == "knock":
        return f"it was knocked: its rays miss by {turned}"
    if found.cause == "clock":
        return f"its clock has stepped by about {stepped}"
    return f"its rays miss by {turned}: it was knocked, or its clock has stepped by about {stepped}"
