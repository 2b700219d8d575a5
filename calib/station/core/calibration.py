"""Is the station calibrated, and if not, what is it waiting for? Pure: what was seen is handed in, jobs come out.

The hazard is "calibrating ... 0 %". Progress here is information, not time: which cameras have shared an object, for
how many seconds, and which pair is the one still missing. Every state has a reason and a next action. A network is
taken or left in whole; a stored one is believed only once what is seen agrees with it.
"""

from collections.abc import Iterable, Set
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import combinations
from typing import Final

import numpy as np

from calib.adjustment.priors import trusted_clocks
from calib.network import POSE_SIZE, Network
from calib.observations import Scene, SiteCamera
from calib.solving.continuity import in_time_of
from calib.station.config import MIN_CAMERAS, CalibrationSection
from calib.station.core.jobs import Solved, SolveJob, SolveResult
from calib.station.core.window import Window

RETRY_GROWTH: Final = 1.25  # of the shared seconds, before an attempt that failed is made again
RETRY_SHARED_S: Final = 5  # shared seconds more, at least
SOONEST_S: Final = 10.0  # s between refinements while the flight is short and each tells much
NOT_TAKEN: Final = "D"  # grade, from which on no network is taken: what is claimed contradicts itself, or nothing holds
WITNESS: Final = "set up one more surveyed camera, off the line between any two: it checks the others"
SOLVER_REST: Final = 5.0  # times as long as it worked the solver rests: a sixth of one core at most


class Phase(StrEnum):
    """Where calibrating stands."""

    COLLECTING = "collecting"
    CALIBRATED = "calibrated"
    SUSPECT = "suspect"
    BLIND = "blind"


@dataclass(frozen=True)
class Standing:
    """The phase, why it is that, and what to do next."""

    phase: Phase
    reason: str
    action: str


@dataclass(frozen=True)
class Pair:
    """What two cameras have shared: seconds in which both saw something."""

    one: str
    other: str
    shared_s: int


@dataclass
class Calibration:
    """The state machine. `network` is the one in force, or None."""

    options: CalibrationSection
    cameras: list[str]
    site: str
    network: Network | None = None
    report: Solved | None = None
    suspects: dict[str, str] = field(default_factory=dict)  # camera left out: why
    contradiction: str = ""  # cameras of the network disagree, and which is wrong is not known: no ray is used
    _failure: str = ""
    _failure_action: str = ""
    _jobs: int = 0
    _tried_shared_s: int = 0
    _tried_unix_ns: int = 0
    _took_s: float = 0.0
    _clocks_known: bool = False
    _before: Network | None = None  # the one that was dropped last
    _asked: bool = False
    _changed: set[str] = field(default_factory=set)  # cameras that are another one since the job began

    # What has been seen

    def pairs(self, window: Window) -> list[Pair]:
        """What each pair of cameras has shared."""
        return [Pair(a, b, window.shared_s(a, b)) for a, b in combinations(self.cameras, 2)]

    def joined(self, pairs: Iterable[Pair], usable: Iterable[str]) -> set[str]:
        """The largest set of usable cameras that hang together through pairs with enough shared flight."""
        usable = set(usable)
        groups = [{camera} for camera in sorted(usable)]
        for pair in pairs:
            if pair.shared_s >= self.options.first_solve_s and {pair.one, pair.other} <= usable:
                touching = [group for group in groups if group & {pair.one, pair.other}]
                groups = [group for group in groups if group not in touching] + [set().union(*touching)]
        return max(groups, key=len, default=set())

    # What to do

    def plan(
        self, window: Window, sites: dict[str, SiteCamera], origin: tuple[float, float, float] | None, now_unix_ns: int
    ) -> SolveJob | None:
        """A job for the solver, if it is time for one."""
        if origin is None:
            return None
        pairs = self.pairs(window)
        joined = self.joined(pairs, sites)
        surveyed = [camera for camera in joined if sites[camera].position_enu is not None]
        shared_s = sum(pair.shared_s for pair in pairs if {pair.one, pair.other} <= joined)
        if len(surveyed) < MIN_CAMERAS or not self._due(joined, shared_s, now_unix_ns):
            return None
        self._tried_shared_s, self._tried_unix_ns, self._asked = shared_s, now_unix_ns, False
        self._changed.clear()
        self._jobs += 1
        chosen = tuple(sites[camera] for camera in self.cameras if camera in joined)
        self._clocks_known = bool(trusted_clocks({camera.id: camera for camera in chosen}))
        observations = {camera.id: window.cameras[camera.id].observations() for camera in chosen}
        scene = Scene(self.site, origin, chosen, observations)
        return SolveJob(self._jobs, scene, self._start())

    def _due(self, joined: set[str], shared_s: int, now_unix_ns: int) -> bool:
        grown = shared_s > self._tried_shared_s * RETRY_GROWTH + RETRY_SHARED_S
        if self.network is None or self.contradiction or self._asked:
            return grown or self._tried_shared_s == 0 or self._asked
        lacking = joined - {camera.id for camera in self.network.cameras} | (joined & self.suspects.keys())
        wait_s = min(self.options.resolve_s, max(SOONEST_S, SOLVER_REST * self._took_s))
        waited = now_unix_ns - self._tried_unix_ns > wait_s * 1e9
        return grown and (waited or bool(lacking))

    def _start(self) -> Network | None:
        """What to begin with: the cameras that are trusted, unless beginning with them has just failed."""
        network = self.network
        if network is None or not self.options.warm_start or self._failure or len(self.trusted) < MIN_CAMERAS:
            return None
        return reduced(network, self.trusted)

    def ask(self) -> None:
        """The operator wants a calibration now."""
        self._asked = True

    # What came of it

    def take(self, done: SolveResult) -> Network | None:
        """Judge a finished job; the new network if it is good."""
        self._took_s = done.seconds
        if done.number != self._jobs:  # its window was thrown away meanwhile
            return None
        if done.solved is None:
            assert done.error is not None
            self._failure, self._failure_action = done.error.what, done.error.action
            return None
        self._failure, self._failure_action = self._not_good_enough(done.solved)
        if self._failure:
            return None
        network, before = self._unchanged(done.solved.network), self.network or self._before
        if network is None:
            return None
        if before is not None and not self._clocks_known:
            network = in_time_of(network, before, self._tried_unix_ns)
        self.network, self.report = network, done.solved
        solved = {camera.id for camera in self.network.cameras}
        self.suspects = {camera: why for camera, why in self.suspects.items() if camera not in solved}
        self.contradiction = ""
        return self.network

    def _unchanged(self, network: Network) -> Network | None:
        """Without cameras that are no longer what was solved; None if too few are left."""
        left = set(network.ids - self._changed)
        if left == network.ids:
            return network
        return reduced(network, left) if len(left) >= MIN_CAMERAS else None

    def _not_good_enough(self, solved: Solved) -> tuple[str, str]:
        """Why a solution is not taken and what to do; empty if it is."""
        rms_px, sigma_m = solved.network.rms_px, solved.sigma_m
        if solved.grade >= NOT_TAKEN:
            return f"the best solution would be graded {solved.grade}: {solved.verdict}", solved.improvement
        if rms_px > self.options.max_rms_px:
            return (
                f"the best solution misses by {rms_px:.1f} px, {self.options.max_rms_px:g} are allowed",
                "check lens files and clocks; a camera that moved must be left alone for a flight",
            )
        if sigma_m > self.options.max_sigma_m:
            return (
                f"positions would be uncertain by {sigma_m:.1f} m, {self.options.max_sigma_m:g} are allowed",
                "fly wider and higher, where all cameras see it",
            )
        return "", ""

    def pass_over(self, done: SolveResult) -> None:
        """Do not judge a job that has come at a bad moment; the same flight is solved again."""
        self._took_s, self._tried_shared_s = done.seconds, 0

    def suspect(self, camera: str, why: str) -> None:
        """Leave a camera out that was off for a while, until it has been calibrated again."""
        self.suspects[camera] = why
        self._jobs += 1  # a solve under way has seen it before and after: its answer is not wanted
        self._tried_shared_s = 0

    def changed(self, camera: str, why: str) -> None:
        """Leave a camera out that is another one from now on. A solve under way knows only the old one: it goes on."""
        self._changed.add(camera)
        if self.network is None or self.network.camera(camera) is None or camera in self.suspects:
            return  # as often as it says so, what the others do is not begun anew
        self.suspects[camera] = why
        self._tried_shared_s = 0

    def contradict(self, why: str) -> None:
        """Use no camera until all have been calibrated again, from what is seen since."""
        self.contradiction = why
        self._jobs += 1
        self._tried_shared_s = 0

    def drop(self, why: str) -> None:
        """The network as a whole is not to be believed."""
        self._before, self.network, self.report = self.network, None, None
        self.suspects.clear()
        self.contradiction = ""
        self._failure, self._failure_action = why, ""
        self._jobs += 1
        self._tried_shared_s = 0

    @property
    def trusted(self) -> set[str]:
        """The cameras whose rays may be used."""
        if self.network is None or self.contradiction:
            return set()
        return set(self.network.ids - self.suspects.keys())

    def trusts(self, camera: str) -> bool:
        """Whether a camera's rays may be used."""
        known = self.network is not None and camera in self.network.ids
        return known and not self.contradiction and camera not in self.suspects

    # What to tell

    def standing(
        self, window: Window, sites: dict[str, SiteCamera], busy: bool, placed: Set[str] | None = None
    ) -> Standing:
        """State, reason and next action. placed: cameras with a position, where that is known of more than `sites`."""
        placed = placed or {name for name, site in sites.items() if site.position_enu is not None}
        if self.network is not None and self.contradiction:
            why, action = self._collecting(window, sites, placed, busy)
            return Standing(Phase.SUSPECT, f"no position is sent: {self.contradiction}; {why}", action)
        if self.network is not None and self.suspects:
            names = ", ".join(f"{camera} ({why})" for camera, why in self.suspects.items())
            return Standing(
                Phase.SUSPECT, f"left out: {names}", "fly where it and two others see it: it is calibrated again"
            )
        if self.network is not None:
            return Standing(Phase.CALIBRATED, self._calibrated(), self._lacking(window, sites))
        return Standing(Phase.COLLECTING, *self._collecting(window, sites, placed, busy))

    def _calibrated(self) -> str:
        assert self.network is not None
        sigma = "" if self.report is None else f", positions to {self.report.sigma_m:.2f} m"
        alone = ", ".join(self.network.rests_on)
        unchecked = f"; nobody checks the word of {alone}: targets are UNVERIFIED" if alone else ""
        return f"{len(self.network.cameras)} cameras, {self.network.rms_px:.2f} px{sigma}{unchecked}"

    def _lacking(self, window: Window, sites: dict[str, SiteCamera]) -> str:
        assert self.network is not None
        missing = [camera for camera in self.cameras if self.network.camera(camera) is None]
        if missing:
            return self._waiting_for(window, sites, missing)
        return WITNESS if self.network.rests_on else ""

    def _collecting(
        self, window: Window, sites: dict[str, SiteCamera], placed: Set[str], busy: bool
    ) -> tuple[str, str]:
        unseen = [camera for camera in self.cameras if camera not in sites]
        if len(sites) < MIN_CAMERAS:
            return f"{', '.join(unseen)}: no lens known yet", "start the boxes; each sends its lens by itself"
        unplaced = [camera for camera in sites if camera not in placed]
        if len(sites) - len(unplaced) < MIN_CAMERAS:
            return (
                f"{', '.join(unplaced)}: no position known yet",
                "survey the tripods (base-station survey), or wait for the boxes' RTK fixes",
            )
        joined = self.joined(self.pairs(window), sites)
        if len(joined) < MIN_CAMERAS:
            missing = [camera for camera in self.cameras if camera not in joined or len(joined) < 2]
            reason = self._waiting_for(window, sites, missing)
            return reason, "fly where both see it; any flying object serves"
        if busy:
            return f"solving from {len(joined)} cameras", "keep flying: every direction helps"
        if self._failure:
            return f"not calibrated: {self._failure}", self._failure_action or "keep flying: it is tried again"
        return "waiting for the solver", "keep flying"

    def _waiting_for(self, window: Window, sites: dict[str, SiteCamera], missing: list[str]) -> str:
        """The pair to wait for: the one with a missing camera that already shares most."""
        pairs = [
            pair
            for pair in self.pairs(window)
            if {pair.one, pair.other} & set(missing)
            and {pair.one, pair.other} <= sites.keys()
            and pair.shared_s < self.options.first_solve_s
        ]
        if not pairs:
            return f"waiting for {missing[0]}"
        best = max(pairs, key=lambda pair: pair.shared_s)
        need_s = self.options.first_solve_s
        return (
            f"waiting for an object that {best.one} and {best.other} both see "
            f"({best.shared_s} of {need_s:.0f} s shared)"
        )


def reduced(network: Network, cameras: set[str]) -> Network:
    """The network of only these cameras."""
    kept = [k for k, camera in enumerate(network.cameras) if camera.id in cameras]
    rows = np.concatenate([POSE_SIZE * k + np.arange(POSE_SIZE) for k in kept])
    return replace(
        network, cameras=tuple(network.cameras[k] for k in kept), covariance=network.covariance[np.ix_(rows, rows)]
    )
