"""The camera box as a process: cameras, receiver, clock and link, started and stopped in order.

Nothing here may wait for the network: a box that has never met a base still detects, dates and keeps what it sees. The
loop below wakes once a second to say how things are; the work is in the threads it started, and each of them is told to
stop before any of them is waited for, so that the whole is down within three seconds.
"""

import contextlib
import logging
import threading
import time
from pathlib import Path
from typing import Final

from edge.camera import CameraWorker
from edge.capture import is_live
from edge.clock.monitor import ClockMonitor
from edge.clock.state import check_clock
from edge.common.health import Check
from edge.common.own_thread import give_way_soon
from edge.common.systemd_notify import Notifier
from edge.config import BoxConfig, CameraConfig
from edge.gnss.receiver import Receiver, check_antenna
from edge.health import HealthBoard
from edge.link.health import LinkHealth
from edge.link.link import Link
from edge.link.spool import Spool, SpoolSettings
from edge.messages import Lens, Tracks, camera_key, encode, station_key
from edge.pictures.thumbnail import focus_score, thumbnail
from edge.temperature import check_temperature

log = logging.getLogger(__name__)

HEALTH_S: Final = 1.0


class Node:
    """A camera box. Use as a context manager; `run` returns when all cameras ended or `stop` is set."""

    def __init__(self, config: BoxConfig, config_file: Path, stop: threading.Event) -> None:
        """Loads the models. Raises ConfigError, ModelError."""
        self._config = config
        self._stop = stop
        # UTC in milliseconds: rises from run to run, and fits a double.
        self._epoch = time.time_ns() // 1_000_000
        self._clock = ClockMonitor(config.clock)
        self._receiver = Receiver(config.gnss) if config.gnss else None
        self._link = Link(config.link, name=f"box {config.site}")
        self._link_health = LinkHealth(self._link, config.bearer, station_key(config.site))
        self._boards = {camera.id: HealthBoard(self._epoch) for camera in config.camera}
        self._spools: dict[str, Spool] = {}
        self._notifier = Notifier()
        self._resources = contextlib.ExitStack()
        self.workers = [self._worker(camera, config_file) for camera in config.camera]

    def _worker(self, camera: CameraConfig, config_file: Path) -> CameraWorker:
        key = camera_key(self._config.site, camera.id, "tracks")

        def publish(tracks: Tracks) -> None:
            payload = encode(tracks)
            if spool := self._spools.get(camera.id):
                spool.keep(tracks.epoch, tracks.seq, tracks.t_unix_ns, payload)
            self._link.publish_bytes(key, payload)

        return CameraWorker(
            self._config,
            camera,
            config_file,
            epoch=self._epoch,
            clock_bound_s=self._clock.bound_s,
            date=self._clock.date,
            publish=publish,
        )

    def __enter__(self) -> "Node":
        self._resources.enter_context(self._link)
        self._resources.enter_context(self._link_health)
        self._clock.start()
        if self._receiver:
            self._receiver.start()
        for worker in self.workers:
            self._announce(worker)
            worker.start()
        return self

    def _announce(self, worker: CameraWorker) -> None:
        site, camera = self._config.site, worker.camera.id
        if self._config.spool:
            settings = SpoolSettings(
                file=str(Path(self._config.spool.folder) / f"{site}-{camera}.sqlite"), max_mb=self._config.spool.max_mb
            )
            spool = Spool(settings, self._link.serve(camera_key(site, camera, "backlog")))
            self._spools[camera] = self._resources.enter_context(spool)
        self._link.declare_presence(camera_key(site, camera))
        self._link.set_state(camera_key(site, camera, "lens"), Lens.of(worker.lens))

    def run(self) -> bool:
        """Say how things are once a second until told to stop or nothing is left to do; whether all went well."""
        give_way_soon()
        self._notifier.ready()
        while not self._stop.is_set() and not all(worker.ended for worker in self.workers):
            self._report()
            self._notifier.feed(self._progress(), time.monotonic())
            self._stop.wait(HEALTH_S)
        self._notifier.stopping()
        self._report()
        return not any(worker.failed for worker in self.workers)

    def _progress(self) -> dict[str, float]:
        """What must keep moving in each camera: what it saw, or else its attempts to see again."""
        running = [worker for worker in self.workers if is_live(worker.camera) and not worker.ended]
        counters = {worker.camera.id: worker.counters() for worker in running}
        return {name: counts["messages"] + counts["source_reopened"] for name, counts in counters.items()}

    def _report(self) -> None:
        now_unix_ns = time.time_ns()
        shared = self._shared_checks()
        fix = self._receiver.said() if self._receiver else None
        for worker in self.workers:
            camera = worker.camera.id
            health = self._boards[camera].update(
                now_unix_ns,
                [*worker.checks(), *self._picture(worker), *shared, *self._check_spool(camera)],
                self._counters(worker),
                now_ns=time.monotonic_ns(),
            )
            self._link.publish(camera_key(self._config.site, camera, "health"), health)
            if fix is not None:
                self._link.set_state(camera_key(self._config.site, camera, "fix"), fix)

    def _picture(self, worker: CameraWorker) -> list[Check]:
        """Show the operator what the camera sees, and how sharp it is."""
        if worker.pipeline.latest is None:
            return []
        image = worker.pipeline.latest[0].image
        self._link.publish_bytes(camera_key(self._config.site, worker.camera.id, "preview"), thumbnail(image))
        return [Check("focus", "ok", f"{focus_score(image):.0f}")]

    def _shared_checks(self) -> list[Check]:
        checks = [check_clock(self._clock.state(), self._config.clock.limit_s), *check_temperature()]
        if self._receiver and self._config.gnss:
            status = self._receiver.status()
            checks.append(Check("gnss", status.level, status.reason, status.action))
            checks.append(check_antenna(self._config.gnss))
        checks += self._link_health.checks(who="the base station")
        return checks

    def _check_spool(self, camera: str) -> list[Check]:
        spool = self._spools.get(camera)
        if spool is None:
            return []
        if spool.error:
            return [Check("spool", "warn", spool.error, "check the disk; observations wait in memory meanwhile")]
        return [Check("spool", "ok", "keeps what was sent")]

    def _counters(self, worker: CameraWorker) -> dict[str, float]:
        return {**worker.counters(), **self._link_health.counters()}

    def __exit__(self, *_: object) -> None:
        self._link_health.ask_to_stop()
        for worker in self.workers:
            worker.ask_to_stop()
        for worker in self.workers:
            worker.close()
        if self._receiver:
            self._receiver.close()
        self._clock.close()
        self._resources.close()
