"""The station itself: everything it decides, and no I/O. The loop around it is calib/station/commands/run.py.

Messages come in by `handle`, with the key they came under and the instant of their arrival; targets go out of it at
once. What needs no hurry is done by `tick`. Live and in a replay the same code runs: time is handed in, and "now" in
the data is read from the data (core/stream_clock.py). Targets depend on the order of messages alone, never
on how fast they came, so a recording played again gives the same targets.

The hazard is sending what is not known. Rays are used only from cameras of a network in force that nothing speaks
against, a frame that is late or refused moves nothing, and without a network nothing is sent at all.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import msgspec
import numpy as np

from calib.guarding.monitor import Finding, Guard
from calib.network import Camera, Network
from calib.observations import SiteCamera
from calib.reference_frame import ReferenceFrame
from calib.station.config import BaseConfig, CameraSection
from calib.station.core.announcements import News, network_message
from calib.station.core.calibration import Calibration, Phase, Standing
from calib.station.core.intake import CameraIntake, Intake
from calib.station.core.jobs import SolveJob, SolveResult
from calib.station.core.outgoing import OutgoingTarget, TargetExport
from calib.station.core.positions import Positions
from calib.station.core.stored_state import StoredState
from calib.station.core.unused import unused
from calib.station.core.window import Window
from calib.tracking.estimates import TargetState
from calib.tracking.options import Limits, TrackerOptions
from calib.tracking.targets import Tracker
from edge.common.health import Check, HealthLevel
from edge.common.units import NS
from edge.health import HealthBoard
from edge.messages import Health, NetworkMessage, Targets, camera_of_key

GUARD_NS: Final = NS // 80  # a piece of guarding: sixteen in a round of the guard's
FAST_NS: Final = NS // 10  # Targets over Zenoh, coasting targets, guards
SLOW_NS: Final = NS  # health, network, plans
LEAST_SIGMA_PX: Final = 0.2  # of a detector that finds none: what an adjustment can tell from a flight's own freedom
NEEDED_CAMERAS: Final = 2  # calibrated ones that send frames: one alone sees directions, no positions
MOST_TARGETS: Final = 1000  # targets; more than ever fly at once
UNASKED_HZ: Final = 50.0  # how often a target is worked out where no output says how often it wants one
IDLE_NS: Final = NS // 4  # without a frame for so long, time passes by the clock alone


@dataclass(frozen=True)
class Tick:
    """What a tick brings: targets to send, messages to publish by topic, a job, words for the operator."""

    targets: list[OutgoingTarget] = field(default_factory=list)
    publish: list[tuple[str, msgspec.Struct]] = field(default_factory=list)
    job: SolveJob | None = None
    texts: list[tuple[HealthLevel, str]] = field(default_factory=list)  # health level, sentence
    slow: bool = False


class Station:
    """All that a station knows."""

    def __init__(
        self,
        config: BaseConfig,
        cameras: dict[str, CameraSection],
        memory: StoredState,
        rate_hz: float = UNASKED_HZ,
        frames: Mapping[str, ReferenceFrame] | None = None,
    ) -> None:
        """rate_hz: the fastest rate at which any output wants a target. frames: of the cameras' surveyed positions."""
        self.config = config
        names = list(cameras)
        tracking = config.tracking
        self.intake = Intake(names)
        self.window = Window(names, config.calibration.window_rows, config.calibration.window_s)
        origin = config.site.origin or (memory.network.origin if memory.network else None)
        self.positions = Positions(cameras, origin, frames)
        self.calibration = Calibration(config.calibration, names, config.site.name)
        self.guard = Guard()
        self._export = TargetExport(names, tracking.min_cameras, tracking.max_sigma_m)
        self._export.placed_in(self.frame)
        self._options = TrackerOptions(
            reorder_horizon_s=tracking.reorder_horizon_s,
            coast_s=tracking.coast_s,
            max_sigma_m=tracking.max_sigma_m,
            max_sigma_share=tracking.max_sigma_share,
            limits=Limits(max_range_m=tracking.max_range_m, max_speed_m_s=tracking.max_speed_m_s),
        )
        self.tracker: Tracker | None = None
        self._stored = memory.network
        self._first_track = memory.first_track
        self._board = HealthBoard(memory.epoch)
        self.health: Health | None = None
        self.standing = Standing(Phase.COLLECTING, "just started", "")
        self.counters: Counter[str] = Counter()
        self.extra_checks: list[Check] = []
        self.muted: set[str] = set()  # cameras that the operator left out: recorded, and not used
        self._busy = False
        self._sigma_px: dict[str, float] = {}  # of each calibrated camera's pixels
        self._clock_sets: Counter[str] = Counter()
        self._last_sent_s: dict[int, float] = {}
        # A tenth early is not early: frames come at their own rate.
        self._send_every_s = 0.9 / rate_hz
        self._fast_ns = self._slow_ns = self._frame_ns = self._guard_ns = 0
        self._news = News()

    # What comes in

    def handle(self, key: str, payload: bytes, now_ns: int) -> list[OutgoingTarget]:
        """Take one message; returns the targets it moved. now_ns: UTC of its arrival, by a clock that never steps."""
        name, topic = camera_of_key(key), key.rpartition("/")[2]
        camera = self.intake.known(name) if name is not None else None
        if camera is None:
            self.counters["strangers"] += 1
            return []
        self.counters[f"received_{topic}"] += 1
        if topic == "tracks":
            return self._frame(camera, payload, now_ns)
        if topic == "lens":
            if self.intake.lens(camera, payload, now_ns):
                self._lens_changed(camera)
        elif topic == "fix":
            doubts = camera.fix_doubts
            self.intake.fix(camera, payload, now_ns)
            self._export.placed_in(self.frame)
            if camera.fix_doubts != doubts:
                return self._position_doubted(camera)
        elif topic == "health":
            self.intake.health(camera, payload, now_ns)
        return []

    def presence(self, camera_id: str, alive: bool) -> None:
        """A box appeared or vanished."""
        camera = self.intake.known(camera_id)
        if camera is not None:
            camera.present = alive

    def _frame(self, camera: CameraIntake, payload: bytes, now_ns: int) -> list[OutgoingTarget]:
        frame = self.intake.frame(camera, payload, now_ns)
        if camera.clock_sets != self._clock_sets[camera.id]:
            self._clock_was_set(camera)
        if frame is None:
            return []
        if camera.id not in self.muted:
            self.window.add(frame)
            if not camera.flooded:  # among a hundred detections some ray always passes by
                self.guard.observe(frame)
        self._frame_ns = now_ns
        if camera.id in self.muted:
            return []
        if self.tracker is None or camera.flooded or not self.calibration.trusts(camera.id):
            return []
        tracker = self.tracker
        sigma_px = np.where(np.isnan(frame.sigma_px), self._sigma_px[camera.id], frame.sigma_px)
        moved = tracker.observe(replace(frame, sigma_px=sigma_px))
        lost = tracker.advance(tracker.newest_s)
        due = {track for track in moved if self._due(track, tracker.newest_s)}
        if not due and not lost:
            return []
        estimates = tracker.estimates(tracker.newest_s, due) + lost
        return self._export.to_wgs84(estimates, tracker.network.origin)

    def _due(self, track: int, newest_s: float) -> bool:
        """Whether any output wants this target again; sending it at every ray would cost more than tracking it."""
        if 0.0 <= newest_s - self._last_sent_s.get(track, -np.inf) < self._send_every_s:
            return False
        if len(self._last_sent_s) > MOST_TARGETS:
            self._last_sent_s.clear()
        self._last_sent_s[track] = newest_s
        return True

    def _lens_changed(self, camera: CameraIntake) -> None:
        self.window.cameras[camera.id].clear()  # pixels of two lenses never go into one adjustment
        self._changed(camera.id, "its lens file was exchanged")

    # What the solver brings

    def solved(self, done: SolveResult) -> Network | None:
        """Take a finished job; the network to be stored, if there is a new one."""
        self._busy = False
        if self.guard.doubt is not None and self.calibration.network is not None:
            self.calibration.pass_over(done)  # it may have been solved from the very rows that are in doubt
            return None
        network = self.calibration.take(done)
        if network is not None:
            self.adopt(network)
        return network

    def adopt(self, network: Network) -> None:
        """Put a network in force, in whole."""
        self.calibration.network = network
        self.guard.trust(network)
        self._sigma_px = {camera.id: self._found_sigma_px(camera) for camera in network.cameras}
        if self.tracker is None:
            self.tracker = Tracker(network, self._options, self._first_track)
        else:
            self.tracker.exchange(network)

    def _found_sigma_px(self, camera: Camera) -> float:
        """One sigma of a camera's pixels where a detection does not say its own: as the adjustment found it."""
        found = camera.sigma_px
        return self.config.tracking.sigma_px if found is None else max(found, LEAST_SIGMA_PX)

    @property
    def frame(self) -> ReferenceFrame:
        """The reference frame of all that is sent."""
        return self.positions.frame(self.intake.cameras)

    @property
    def next_track(self) -> int:
        """The next target's number."""
        return self._first_track if self.tracker is None else self.tracker.next_track

    # What time brings

    def now_unix_ns(self, now_ns: int) -> int:
        """The data's now; the arrival clock's until there is data."""
        return self.intake.clock.now_unix_ns(now_ns) or now_ns

    def tick(self, now_ns: int) -> Tick:
        """What is due at now_ns; call it often."""
        if now_ns - self._guard_ns >= GUARD_NS:
            self._guard_ns = now_ns
            self.guard.work(self.now_unix_ns(now_ns))
        if now_ns - self._fast_ns < FAST_NS:
            return Tick()
        self._fast_ns = now_ns
        now_unix_ns = self.now_unix_ns(now_ns)
        targets = self._coast(now_ns, now_unix_ns) + self._watch(now_unix_ns)
        publish: list[tuple[str, msgspec.Struct]] = []
        message = self.targets(now_unix_ns)
        if message is not None:
            publish.append(("targets", message))
        if now_ns - self._slow_ns < SLOW_NS:
            return Tick(targets, publish)
        self._slow_ns = now_ns
        job = self._plan(now_unix_ns)
        self.standing = self._blind(now_ns) or self.standing
        health = self._assess(now_ns, now_unix_ns)
        publish += [("network", self.network_message(now_unix_ns)), ("health", health)]
        return Tick(targets, publish, job, self._news.since(health, self.standing), slow=True)

    def _coast(self, now_ns: int, now_unix_ns: int) -> list[OutgoingTarget]:
        """Targets nobody has just seen, and farewells while no frames come."""
        tracker = self.tracker
        if tracker is None:
            return []
        idle = now_ns - self._frame_ns > IDLE_NS
        now_s = tracker.site_time_s(now_unix_ns) if idle else tracker.newest_s
        if not np.isfinite(now_s):
            return []
        lost = tracker.advance(now_s) if idle else []
        coasting = [e for e in tracker.estimates(now_s) if e.state is TargetState.COASTING]
        return self._export.to_wgs84(coasting + lost, tracker.network.origin)

    def _watch(self, now_unix_ns: int) -> list[OutgoingTarget]:
        """Ask the guard; returns the farewells of targets that stood on what is no longer believed."""
        for box in self.intake.cameras.values():
            self.guard.state_clock(box.id, box.clock_bound_s)
        ended: list[OutgoingTarget] = []
        findings = self.guard.findings(now_unix_ns)
        network, doubt = self.calibration.network, self.guard.doubt
        camera = network.camera(doubt.camera) if network is not None and doubt is not None else None
        self._export.doubt(camera, doubt.miss_rad if doubt is not None else 0.0)
        for finding in findings:
            if finding.camera is None:
                ended += self._hold_back(finding)
            elif finding.camera in self.calibration.trusted:
                ended += self._accuse(finding.camera, finding)
        calibration = self.calibration
        if calibration.network is not None and not calibration.contradiction and len(calibration.trusted) < 2:
            self._drop("fewer than two cameras are left that nothing speaks against")
        if self._stored is not None:
            self._try_stored(now_unix_ns)
        return ended

    def _accuse(self, camera: str, finding: Finding) -> list[OutgoingTarget]:
        """Leave a camera out, and take back what its rays did to targets since the fault."""
        tracker = self.tracker
        self._leave_out(camera, finding.reason, finding.since_unix_ns)
        if tracker is None:
            return []
        return self._export.to_wgs84(tracker.distrust(camera, finding.miss_rad), tracker.network.origin)

    def _hold_back(self, finding: Finding) -> list[OutgoingTarget]:
        """Cameras contradict each other and nobody knows which is wrong: no position is sent on any one's word."""
        tracker = self.tracker
        self.calibration.contradict(finding.reason)
        self.guard.forget()
        for window in self.window.cameras.values():
            window.forget_before(finding.since_unix_ns)
        return [] if tracker is None else self._export.to_wgs84(tracker.dismiss(), tracker.network.origin)

    def _position_doubted(self, camera: CameraIntake) -> list[OutgoingTarget]:
        """A position that the network in force was laid on is contradicted: nothing is sent until one covers it.

        Where the other cameras checked it, and nothing speaks against theirs, the network stands without its word: only
        that camera is left out.
        """
        network = self.calibration.network
        if network is None or network.camera(camera.id) is None or not self.positions.by_fixes(camera.id):
            return []
        another = any(box.fix_doubt for box in self._boxes_of(network) if box.id != camera.id)
        if camera.id not in network.rests_on and not another:
            self._changed(camera.id, f"its position: {camera.fix_doubt}")
            return []
        self.calibration.contradict(f"{camera.id}: {camera.fix_doubt}")
        self.guard.forget()
        tracker = self.tracker
        return [] if tracker is None else self._export.to_wgs84(tracker.dismiss(), tracker.network.origin)

    def _clock_was_set(self, camera: CameraIntake) -> None:
        """A box whose clock was set has two stretches of time; only the new one counts."""
        self._clock_sets[camera.id] = camera.clock_sets
        self.window.cameras[camera.id].clear()
        self._changed(camera.id, "its clock was set")

    def _changed(self, camera: str, why: str) -> None:
        """A camera is another one from now on, by its own word; what the others show and solve goes on."""
        self.calibration.changed(camera, why)
        self.guard.ignore(camera)

    def _leave_out(self, camera: str, why: str, since_unix_ns: int) -> None:
        self.calibration.suspect(camera, why)
        self.guard.ignore(camera)
        self.window.cameras[camera].forget_before(since_unix_ns)

    def _drop(self, why: str) -> None:
        self._first_track = self.next_track
        self._stored = self.calibration.network  # tried again as a stored one is: rays may agree after all
        self.calibration.drop(why)
        self.tracker = None
        self.guard.forget()

    def _try_stored(self, now_unix_ns: int) -> None:
        """Believe the stored network once rays agree with it; forget it once they do not."""
        assert self._stored is not None
        if any(self.positions.by_fixes(box.id) and box.fix_doubt for box in self._boxes_of(self._stored)):
            return  # what it was laid on is not stood by
        if self.calibration.network is not None:
            self._stored = None
            return
        verdict = self.guard.agrees(self._stored, now_unix_ns)
        if verdict is True:
            network, self._stored = self._stored, None
            self.adopt(network)
        elif verdict is False:
            self._stored = None

    def _boxes_of(self, network: Network) -> list[CameraIntake]:
        return [box for box in self.intake.cameras.values() if network.camera(box.id) is not None]

    def _plan(self, now_unix_ns: int) -> SolveJob | None:
        self.window.expire(now_unix_ns)
        self.positions.update(self.intake.cameras)
        sites = self._sites()
        job = None if self._busy else self.calibration.plan(self.window, sites, self.positions.origin, now_unix_ns)
        self._busy = self._busy or job is not None
        placed = {name for name, box in self.intake.cameras.items() if self.positions.known(name, box)}
        self.standing = self.calibration.standing(self.window, sites, self._busy, placed)
        if self._stored is not None and self.calibration.network is None:
            action = "fly where two cameras see it: it is believed within two seconds"
            self.standing = Standing(Phase.COLLECTING, "checking the stored calibration against what is seen", action)
        return job

    def _blind(self, now_ns: int) -> Standing | None:
        """How a calibrated station stands that too few cameras send frames to; None if enough do."""
        trusted = self.calibration.trusted
        if not trusted:
            return None
        boxes = [self.intake.cameras[name] for name in sorted(trusted - self.muted)]
        silent = [box.id for box in boxes if not box.online(now_ns, self.config.tracking.stale_s)]
        if len(boxes) - len(silent) >= NEEDED_CAMERAS:
            return None
        seeing = f"{len(boxes) - len(silent)} of {len(self.intake.cameras)} cameras can be used, {NEEDED_CAMERAS} must"
        action = f"look at the boxes, cameras and links of {', '.join(silent)}" if silent else "use more cameras"
        return Standing(Phase.BLIND, f"no position can be sent: {seeing}", action)

    def _sites(self) -> dict[str, SiteCamera]:
        found = {name: self.positions.site_camera(name, box) for name, box in self.intake.cameras.items()}
        return {name: site for name, site in found.items() if site is not None}

    # What is told

    def current(self, now_unix_ns: int) -> list[OutgoingTarget]:
        """All targets as of now, which is later than any of their last measurements."""
        if self.tracker is None:
            return []
        now_s = min(self.tracker.site_time_s(now_unix_ns), self.tracker.newest_s + self._options.coast_s)
        return self._export.to_wgs84(self.tracker.predicted(now_s), self.tracker.network.origin)

    def targets(self, now_unix_ns: int) -> Targets | None:
        """All targets as of now, as a message; None without a network."""
        if self.tracker is None:
            return None
        sent = [target.message() for target in self.current(now_unix_ns)]
        return Targets(t_unix_ns=now_unix_ns, targets=sent)

    def network_message(self, now_unix_ns: int) -> NetworkMessage:
        """State, reason, next action, and the network in force."""
        return network_message(self.standing, self.calibration.network, self.positions.origin, now_unix_ns)

    def _assess(self, now_ns: int, now_unix_ns: int) -> Health:
        checks = self.intake.checks(now_ns, self.config.tracking.stale_s)
        checks += self.positions.checks(self.intake.cameras) + self.positions.frame_checks(self.intake.cameras)
        checks += [
            Check(f"guard {camera}", "warn", why, "fly where it and two others see it")
            for camera, why in self.calibration.suspects.items()
        ]
        level: HealthLevel = "ok" if self.standing.phase is Phase.CALIBRATED else "warn"
        if self.calibration.contradiction or self.standing.phase is Phase.BLIND:
            level = "fail"
        checks.append(Check("calibration", level, self.standing.reason, self.standing.action))
        counters = dict(self.counters)
        if self.tracker is not None:
            counters |= {f"tracker_{name}": count for name, count in self.tracker.counters.items()}
            counters["targets_of_one_camera"] = self.tracker.alone
            checks += unused(self.tracker.refused(), self._options)
        counters["refused_targets"] = self._export.refused
        self.health = self._board.update(now_unix_ns, checks + self.extra_checks, counters, now_ns=now_ns)
        return self.health
