"""The station's core with the world around it: network, sockets, disk, solver. One `turn` is one round of the loop.

The hazard is a loop that waits. Zenoh has threads of its own, the solver a process, the disk a thread; here nothing
blocks but the wait for the next message, and that at most for a fiftieth of a second. What came is in the recording
before anything is computed from it.
"""

import logging
import shutil
import time
from collections import deque
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from pymavlink.dialects.v20 import common

from calib.network import Network, to_toml
from calib.station.archive.backfill import Backfill
from calib.station.archive.recording import Recorder
from calib.station.archive.state_store import StateStore
from calib.station.config import BaseConfig
from calib.station.core.calibration import Phase
from calib.station.core.jobs import SolveResult
from calib.station.core.positions import with_survey
from calib.station.core.station import Station, Tick
from calib.station.outputs.mavlink.broadcast import Broadcast
from calib.station.outputs.mavlink.messages import TrackerStatus
from calib.station.page.process import REPORT_FOLDER, PageProcess
from calib.station.page.wire import Wish
from calib.station.status.server import StatusServer, open_status
from calib.station.status.snapshot import snapshot
from calib.station.worker import LIVE, Solver, Worker
from edge.common.health import Check
from edge.link.health import LinkHealth
from edge.link.inbox import Inbox, Received
from edge.link.link import Link
from edge.messages import camera_key, camera_of_key, encode, station_key

log = logging.getLogger(__name__)

WAIT_S: Final = 0.02  # the longest the loop sleeps
PICTURES: Final = 64  # waiting: one of each of twice as many cameras as there may be
LATE_A_TURN: Final = 20  # rows of history written between two looks at what is live
QUEUE: Final = 4096  # messages waiting: more than a second of 100 cameras
LATENCIES: Final = 2000  # messages looked back on for latency
SYNCED_S: Final = 0.02  # a clock bound good enough to be called synchronised: 0.4 m at 20 m/s
REPLAYED_MS: Final = 10_000.0
MAV_STATES: Final = {
    Phase.COLLECTING: common.MAV_STATE_CALIBRATING,
    Phase.CALIBRATED: common.MAV_STATE_ACTIVE,
    Phase.SUSPECT: common.MAV_STATE_CRITICAL,
}


class Runner:
    """The station with everything that touches the world around it."""

    def __init__(self, config: BaseConfig, folder: Path, stack: ExitStack, solver: Solver | str = LIVE) -> None:
        """folder: what relative paths are relative to. stack: closes all of it, last opened first."""
        self.config = config
        site = config.site.name
        cameras = with_survey(config, folder)
        self.keeper = stack.enter_context(StateStore(folder / config.state_folder))
        memory = self.keeper.load(set(cameras))
        self.station = Station(config, cameras, memory)
        self.epoch = memory.epoch
        self.recordings = None if config.recording.folder is None else folder / config.recording.folder
        self.recorder = self._recorder()
        self.records = self.recorder is not None
        stack.callback(self._finish_recording)
        self.reports = folder / config.state_folder / REPORT_FOLDER
        self.worker = stack.enter_context(Worker(solver))
        signing = memory.signing_ticks
        self.broadcast = stack.enter_context(Broadcast(config, folder, memory.epoch, signing, self._record_mavlink))
        self.link = stack.enter_context(Link(config.link, name="station"))
        self.link_health = LinkHealth(self.link)
        self.inbox = self.link.subscribe(camera_key(site, "*", "tracks"), QUEUE)
        self.states = [self.link.watch_state(camera_key(site, "*", topic)) for topic in ("lens", "fix", "health")]
        self.presence = self.link.watch_presence(camera_key(site, "*"))
        self.backfill = stack.enter_context(Backfill(self.link, site, folder / config.state_folder / "ledger.json"))
        self.link.declare_presence(station_key(site))
        self.status: StatusServer | PageProcess = open_status(config, folder)
        stack.enter_context(self.status)
        # An arrival clock that never steps, and yet reads as UTC in the recording.
        self._utc_ns = time.time_ns() - time.monotonic_ns()
        self.began_ns = self.now_ns()
        self.turns = 0
        self._in_force: Network | None = None
        self._pictures: Inbox[Received] | None = None
        self.latencies_ms: deque[float] = deque(maxlen=LATENCIES)
        self.exposures_ms: deque[float] = deque(maxlen=LATENCIES)

    def now_ns(self) -> int:
        """UTC nanoseconds by the monotonic clock."""
        return time.monotonic_ns() + self._utc_ns

    def _recorder(self) -> Recorder | None:
        options = self.config.recording
        if self.recordings is None:
            return None
        name = self.config.site.name
        return Recorder(self.recordings, name, max_file_mb=options.max_file_mb, min_free_mb=options.min_free_mb)

    def _finish_recording(self) -> None:
        if self.recorder is not None:
            self.recorder.close()

    def record(self, key: str, payload: bytes, now_ns: int) -> None:
        """Put a message into the recording."""
        if self.recorder is not None and self.records:
            self.recorder.write(key, payload, now_ns)

    @property
    def _cannot_record(self) -> bool:
        return self.recorder is None or bool(self.recorder.fault)

    def _record_mavlink(self, url: str, frame: bytes) -> None:
        if self.recorder is not None and self.records:
            payload = b'{"endpoint":"%s","frame":"%s"}' % (url.encode(), frame.hex().encode())
            self.recorder.write(station_key(self.config.site.name, "mavlink"), payload, self.now_ns())

    # One turn of the loop

    def turn(self) -> bool:
        """Wait for messages, and do what is due; whether a second has gone by."""
        self.turns += 1
        self.link.wait(WAIT_S)
        self._hear_states()
        for message in self.inbox.drain():
            self._hear(message)
        for late in self.backfill.late.drain(LATE_A_TURN):
            self.record(late.key, late.payload, self.now_ns())
        now_ns = self.now_ns()
        tick = self.station.tick(now_ns)
        self._do(tick, now_ns)
        done = self.worker.poll()
        if done is not None:
            self._solved(done, now_ns)
        if self.station.calibration.network is not self._in_force:
            self._adopted(now_ns)
        self.broadcast.receive(now_ns, self.station.now_unix_ns(now_ns), self._wish)
        self._attend_page(now_ns)
        self.backfill.paused = self._cannot_record or not self.records
        return tick.slow

    def _attend_page(self, now_ns: int) -> None:
        if self._pictures is None and self.status.watched:  # before that, no box sends any
            self._pictures = self.link.subscribe(camera_key(self.config.site.name, "*", "preview"), PICTURES)
        for picture in self._pictures.drain() if self._pictures is not None else ():
            self.status.feed(f"preview/{camera_of_key(picture.key)}", picture.payload)
        for wish in self.status.wishes():
            self._grant(wish)
        if self.station.health is not None and self.status.due():
            self.status.show(snapshot(self, now_ns))

    def _grant(self, wish: Wish) -> None:
        log.info("the operator: %s %s", wish.do, wish.camera)
        if wish.do == "calibrate":
            self._wish("calibrate")
        elif wish.do in ("record", "stop"):
            self.records = wish.do == "record" and self.recorder is not None
            if self.recorder is not None and not self.records:
                self.recorder.close()
        elif wish.camera in self.station.intake.cameras:
            (self.station.muted.add if wish.do == "mute" else self.station.muted.discard)(wish.camera)

    def _hear(self, message: Received) -> None:
        now_ns = message.t_monotonic_ns + self._utc_ns
        self.record(message.key, message.payload, now_ns)
        targets = self.station.handle(message.key, message.payload, now_ns)
        self.status.feed(f"tracks/{camera_of_key(message.key)}", message.payload)
        self._note_received(message)
        if targets:
            self.broadcast.targets(targets, now_ns, self.synced)
            sent_ns = self.now_ns()
            self.latencies_ms.append((sent_ns - now_ns) * 1e-6)
            self.exposures_ms.append((sent_ns - targets[0].t_unix_ns) * 1e-6)

    def _note_received(self, message: Received) -> None:
        camera = self.station.intake.cameras.get(camera_of_key(message.key) or "")
        if camera is not None and camera.epoch is not None and not self._cannot_record:
            self.backfill.have_number(camera.id, camera.epoch, camera.next_seq - 1)

    def _hear_states(self) -> None:
        for inbox in self.states:
            for message in inbox.drain():
                now_ns = message.t_monotonic_ns + self._utc_ns
                self.record(message.key, message.payload, now_ns)
                self.station.handle(message.key, message.payload, now_ns)
                if message.key.endswith("/health"):
                    self.status.feed(f"health/{camera_of_key(message.key)}", message.payload, keep=True)
        for token in self.presence.drain():
            camera = camera_of_key(token.key)
            self.record(token.key, b'{"alive":%s}' % (b"true" if token.alive else b"false"), self.now_ns())
            if camera is not None:
                self.station.presence(camera, token.alive)

    def _do(self, tick: Tick, now_ns: int) -> None:
        self.broadcast.targets(tick.targets, now_ns, self.synced)
        for topic, message in tick.publish:
            key, payload = station_key(self.config.site.name, topic), encode(message)
            self.record(key, payload, now_ns)
            self.status.feed(topic, payload, keep=topic == "network")
            if topic == "network":
                self.link.set_state(key, message)
            else:
                self.link.publish_bytes(key, payload)
        if tick.job is not None:
            self.worker.submit(tick.job)
        if tick.slow:
            self._every_second(tick, now_ns)

    def _every_second(self, tick: Tick, now_ns: int) -> None:
        for level, text in tick.texts:
            log.log(logging.INFO if level == "ok" else logging.WARNING, "%s", text)
        ticks = self.broadcast.second(self._tracker_status(now_ns), tick.texts, now_ns)
        self.keeper.note(self.station.next_track, ticks)
        self.station.extra_checks = self._own_checks()
        self.status.show(snapshot(self, now_ns))

    def _solved(self, done: SolveResult, now_ns: int) -> None:
        network = self.station.solved(done)
        self.broadcast.calibrated(network is not None, now_ns)
        if done.error is not None:
            log.warning("calibration: %s (%.1f s)", done.error, done.seconds)
        if network is not None:
            log.info("calibrated in %.1f s: network %s", done.seconds, network.fingerprint)
            self.keeper.store_network(network)
            self.worker.report(self.reports)

    def _adopted(self, now_ns: int) -> None:
        """Another network is in force, or none: tell the ports its origin, and put all of it into the recording."""
        network = self._in_force = self.station.calibration.network
        if network is not None:
            self.broadcast.move_to(network.origin)
        text = "" if network is None else to_toml(network)
        key = station_key(self.config.site.name, "calibration")
        self.record(key, msgspec.json.encode({"network_toml": text}), now_ns)

    def _wish(self, wish: str) -> bool:
        if wish != "calibrate" or self.worker.busy:
            return False
        self.station.calibration.ask()
        return True

    # How it is

    @property
    def counters(self) -> dict[str, float]:
        """What the parts around the core counted."""
        late = self.backfill.counters
        found = self.link_health.counters()
        found |= {f"backfill_{name}": getattr(late, name) for name in late.__struct_fields__}
        found |= {"inbox_dropped": self.inbox.dropped} | self.broadcast.counters
        return found | {"recorded": 0 if self.recorder is None else self.recorder.messages}

    @property
    def free_mb(self) -> int | None:
        """What is left on the recordings' disk."""
        try:
            return None if self.recordings is None else shutil.disk_usage(self.recordings).free // 10**6
        except OSError:  # no such folder before the first recording
            return None

    @property
    def synced(self) -> bool:
        """Whether at least two calibrated cameras say that their UTC is good."""
        bounds = [self.station.intake.cameras[camera].clock_bound_s for camera in self.station.calibration.trusted]
        return sum(bound is not None and bound <= SYNCED_S for bound in bounds) >= 2

    def _own_checks(self) -> list[Check]:
        checks = self.link_health.checks(who="the port") + self.broadcast.checks(self.now_ns())
        faults = [("disk", self.keeper.fault), ("recording", self.recorder.fault if self.recorder else "")]
        checks += [Check(name, "warn", fault, "look at the disk: space, rights") for name, fault in faults if fault]
        return checks

    def _tracker_status(self, now_ns: int) -> TrackerStatus:
        station, stale_s = self.station, self.config.tracking.stale_s
        boxes = list(station.intake.cameras.values())[:32]
        trusted = station.calibration.trusted
        online = sum(1 << k for k, box in enumerate(boxes) if box.online(now_ns, stale_s))
        tracker, phase = station.tracker, station.standing.phase
        health = MAV_STATES[phase] if online else common.MAV_STATE_STANDBY
        exposures = list(self.exposures_ms)
        latency_ms = float(np.percentile(exposures, 95)) if exposures else None
        return TrackerStatus(
            t_unix_ns=station.now_unix_ns(now_ns),
            uptime_ms=(now_ns - self.began_ns) // 10**6,
            configured=sum(1 << k for k in range(len(boxes))),
            online=online,
            synced=sum(
                1 << k for k, b in enumerate(boxes) if b.clock_bound_s is not None and b.clock_bound_s < SYNCED_S
            ),
            calibrated=sum(1 << k for k, box in enumerate(boxes) if box.id in trusted),
            # A recording played again was exposed long ago: that is no latency.
            latency_ms=latency_ms if latency_ms is not None and 0 <= latency_ms < REPLAYED_MS else None,
            confirmed=0 if tracker is None else tracker.confirmed,
            tentative=0 if tracker is None else tracker.tentative,
            system_status=health,
        )
