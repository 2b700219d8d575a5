"""The station's core with the world around it: network, outputs, disk, solver. One `turn` is one round of the loop.

The hazard is a loop that waits. Zenoh has threads of its own, the solver a process, the disk a thread; here nothing
blocks but the wait for the next message, and that at most for a fiftieth of a second. What came is in the recording
before anything is computed from it.
"""

import logging
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Final

import msgspec

from calib.network import Network, to_toml
from calib.station.archive.state_lock import StateLock
from calib.station.archive.state_store import REPORT_FOLDER, StateStore
from calib.station.archive.station_recording import StationRecording
from calib.station.arrival_clock import ArrivalClock
from calib.station.boxes import Boxes
from calib.station.config import BaseConfig
from calib.station.core.jobs import SolveResult
from calib.station.core.outgoing import OutgoingTarget
from calib.station.core.station import Station, Tick
from calib.station.core.surveyed_site import SurveyedSite
from calib.station.core.versions import check_versions
from calib.station.display import open_display
from calib.station.fence import Fence
from calib.station.latency import Latencies
from calib.station.orders import Orders
from calib.station.outputs.registry import OutputHost, open_outputs
from calib.station.own_clock import check_own_clock
from calib.station.standing import LoopWatch, disk_checks, fault_of, standing_of, synced
from calib.station.status.snapshot import StationView, snapshot
from calib.station.status.status import StationStatus
from calib.station.survey.in_force import frames_in_force, with_survey
from calib.station.worker import LIVE, Solver, Worker
from edge import __version__
from edge.clock.monitor import ClockMonitor
from edge.link.inbox import Received
from edge.messages import camera_of_key, encode, station_key

log = logging.getLogger(__name__)

WAIT_S: Final = 0.02  # the longest the loop sleeps
REPORT: Final = "keep the recording and report it with the log"
ALIVE: Final = {True: b'{"alive":true}', False: b'{"alive":false}'}  # as a token is recorded


class Runner:
    """The station with everything that touches the world around it."""

    def __init__(self, config: BaseConfig, folder: Path, stack: ExitStack, solver: Solver | str = LIVE) -> None:
        """folder: what relative paths are relative to. stack: closes all of it, last opened first."""
        site = self._site = config.site.name
        state_folder = folder / config.state_folder
        self.clock = ArrivalClock()
        self.began_ns = self.clock.now_ns()
        self.turns = 0
        self._reports = state_folder / REPORT_FOLDER
        self._signing_ticks = 0
        self._in_force: Network | None = None
        cameras = with_survey(config, folder)
        stack.enter_context(StateLock(state_folder))
        self.keeper = stack.enter_context(StateStore(state_folder))
        state = self.keeper.load(set(cameras))
        self.epoch = state.epoch
        self.recording = stack.enter_context(closing(StationRecording(config.recording, folder, site)))
        if self.recording.kept is not None:
            stack.enter_context(self.recording.kept)
        survey = SurveyedSite(site, config.site.origin, cameras).message(self.began_ns)
        self.recording.hold(station_key(site, "survey"), encode(survey))
        self.worker = stack.enter_context(Worker(solver))
        host = OutputHost(config.site, folder, state, self._record_own, self._keep_signing_ticks)
        self.outputs = open_outputs(config, host, stack)
        frames = frames_in_force(config, folder)
        self.station = Station(config, cameras, state, self.outputs.rate_hz, frames)
        self.orders = Orders(self.station, self.worker, self.recording)
        self.boxes = Boxes(config.link, site, state_folder / "ledger.json", stack)
        self.display = open_display(config, folder, self.boxes.link, stack)
        self._utc = stack.enter_context(ClockMonitor(config.clock))
        self._clock_config = config.clock
        self.latencies = Latencies()
        self.loop = LoopWatch(self.clock.now_ns())
        self._messages, self._core = Fence("messages", "warn", REPORT), Fence("core", "fail", REPORT)

    # One turn of the loop

    def turn(self) -> bool:
        """Wait for messages, and do what is due; whether a second has gone by."""
        self.turns += 1
        self.boxes.wait(WAIT_S)
        self._take_states()
        for message in self.boxes.tracks():
            self._take_tracks(message)
        for late in self.boxes.late():
            self.recording.write(late.key, late.payload, self.clock.now_ns())
        now_ns = self.clock.now_ns()
        self.loop.turned(now_ns)
        tick = Tick()
        with self._core:
            tick = self.station.tick(now_ns)
        self._do(tick, now_ns)
        done = self.worker.poll()
        if done is not None:
            with self._core:
                self._take_solution(done, now_ns)
        if self.station.calibration.network is not self._in_force:
            self._adopted(now_ns)
        self.outputs.receive(now_ns, self.station.now_unix_ns(now_ns), self.orders.command)
        for command in self.display.commands():
            self.orders.obey(command)
        if self.station.health is not None and self.display.due():
            self.display.show(self.status())
        self.boxes.pause_backfill(not self.recording.on)
        return tick.slow

    # What comes in

    def _take_tracks(self, message: Received) -> None:
        now_ns = self.clock.at(message.t_monotonic_ns)
        self.recording.write(message.key, message.payload, now_ns)
        targets = self._handled(message, now_ns)
        self.display.feed("tracks", message.payload, key=message.key)
        box = self.station.intake.cameras.get(camera_of_key(message.key) or "")
        if box is not None and self.recording.possible:
            self.boxes.recorded(box)
        if targets:
            self.outputs.targets(targets, now_ns, synced(self.station))
            self.latencies.note(now_ns, targets[0].t_unix_ns, self.clock.now_ns())

    def _handled(self, message: Received, now_ns: int) -> list[OutgoingTarget]:
        with self._messages:
            return self.station.handle(message.key, message.payload, now_ns)
        return []

    def _take_states(self) -> None:
        for message in self.boxes.states():
            now_ns = self.clock.at(message.t_monotonic_ns)
            self.recording.write(message.key, message.payload, now_ns)
            self._handled(message, now_ns)
            if message.key.endswith("/health"):
                self.display.feed("health", message.payload, key=message.key, keep=True)
        for token in self.boxes.presence():
            self.recording.write(token.key, ALIVE[token.alive], self.clock.now_ns())
            camera = camera_of_key(token.key)
            if camera is not None:
                self.station.presence(camera, token.alive)

    def _take_solution(self, done: SolveResult, now_ns: int) -> None:
        network = self.station.solved(done)
        self.outputs.calibrated(network is not None, now_ns)
        if done.error is not None:
            log.warning("calibration: %s (%.1f s)", done.error, done.seconds)
        if network is not None:
            log.info("calibrated in %.1f s: network %s", done.seconds, network.fingerprint)
            self.keeper.store_network(network)
            self.worker.report(self._reports)

    # What goes out

    def _do(self, tick: Tick, now_ns: int) -> None:
        self.outputs.targets(tick.targets, now_ns, synced(self.station))
        for topic, message in tick.publish:
            key, payload = station_key(self._site, topic), encode(message)
            self.recording.write(key, payload, now_ns)
            self.display.feed(topic, payload, keep=topic == "network")
            self.boxes.publish(key, message, payload, state=topic == "network")
        if tick.job is not None:
            self.worker.submit(tick.job)
        if tick.slow:
            self._every_second(tick, now_ns)

    def _every_second(self, tick: Tick, now_ns: int) -> None:
        for level, text in tick.texts:
            log.log(logging.INFO if level == "ok" else logging.WARNING, "%s", text)
        fenced = self._messages.checks(now_ns) + self._core.checks(now_ns)
        own = [self.loop.check(), *self.boxes.checks(), *fenced]
        latency_ms, fault = self.latencies.exposure_ms, fault_of(own)
        standing = standing_of(self.station, now_ns, began_ns=self.began_ns, latency_ms=latency_ms, fault=fault)
        self.outputs.second(standing, tick.texts, now_ns)
        self.keeper.note(self.station.next_track, self._signing_ticks)
        disk = disk_checks(disk=self.keeper.fault, recording=self.recording.fault)
        own.append(check_own_clock(self._utc.state(), self._clock_config))
        own.append(check_versions(__version__, self.station.intake.cameras.values()))
        own += self.recording.checks()
        self.station.extra_checks = own + self.outputs.checks(now_ns) + disk
        self.display.show(self.status())

    def _adopted(self, now_ns: int) -> None:
        """Another network is in force, or none: tell the outputs its origin, and put all of it into the recording."""
        network = self._in_force = self.station.calibration.network
        if network is not None:
            self.outputs.moved(network.origin)
        text = "" if network is None else to_toml(network)
        self._record_own("calibration", msgspec.json.encode({"network_toml": text}))

    def _record_own(self, topic: str, payload: bytes) -> None:
        self.recording.write(station_key(self._site, topic), payload, self.clock.now_ns())

    def _keep_signing_ticks(self, ticks: int) -> None:
        self._signing_ticks = ticks

    # How it is

    def status(self) -> StationStatus:
        """How everything is now; once the first second is over."""
        recording = self.recording
        view = StationView(
            station=self.station,
            epoch=self.epoch,
            began_ns=self.began_ns,
            solving=self.worker.busy,
            latency_ms=self.latencies.arrival_ms,
            endpoints=self.outputs.status,
            recording=None if recording.path is None else str(recording.path),
            recording_folder=None if recording.folder is None else str(recording.folder),
            free_mb=recording.free_mb,
            counters=self.boxes.counters
            | self.outputs.counters
            | recording.counters
            | {"recorded": recording.messages},
        )
        return snapshot(view, self.clock.now_ns())
