"""One camera at work: its reader, its pipeline, and the thread between them.

A camera that fails must not take its neighbours on the box with it. So each has a thread of its own; what it cannot
overcome ends that thread, is kept, and is what the operator is told.
"""

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from edge.capture import FrameSource, is_live, is_lossless, open_source
from edge.capture.frame import Picture, Remark
from edge.capture.reader import Reader, ReaderState
from edge.common.errors import ConfigError, SkyfixError
from edge.common.health import SEVERITY, Check
from edge.common.own_thread import OwnThread
from edge.common.utc import Dated
from edge.config import BoxConfig, CameraConfig, load_lens
from edge.detector.mask_file import load_mask
from edge.detector.opening import open_detector
from edge.gate import TrackRow
from edge.messages import Tracks
from edge.pictures.view import ViewWatch
from edge.pipeline import CameraFacts, Pipeline, SideBySide

log = logging.getLogger(__name__)

CAMERA_CLOSE_S: Final = 1.0  # a frame under way, a scan, a full-frame model
FRAME_PATIENCE_S: Final = 0.25  # how long to wait for a frame before looking whether to stop
DROPS_WARN: Final = 0.02  # share of frames lost to a slow detector that the operator should know of
LATE_WARN: Final = 0.1  # places a frame that waited for more than half a second to be looked at
STARTING_S: Final = 10.0  # opening a network camera and loading a model may take so long


class CameraWorker(OwnThread):
    """Reads, detects and hands on the Tracks of one camera. publish: called from the camera's own thread."""

    def __init__(
        self,
        box: BoxConfig,
        camera: CameraConfig,
        config_file: Path,
        *,
        epoch: int,
        clock_bound_s: Callable[[], float | None],
        date: Callable[[int], Dated],
        publish: Callable[[Tracks], None],
    ) -> None:
        """Opens the model, not the camera. Raises ConfigError, ModelError."""
        super().__init__(f"camera-{camera.id}", CAMERA_CLOSE_S)
        self.camera = camera
        self.lens = load_lens(camera, config_file)
        self.mask = load_mask(camera, config_file, self.lens.size_px)
        self.error: SkyfixError | None = None
        self._publish = publish
        settings = box.detector_of(camera)
        self._detector = open_detector(settings, background=not is_lossless(camera), mask=self.mask)
        facts = CameraFacts(camera.id, self.lens, camera.readout_s, box.gate_of(camera), epoch)
        self.pipeline = Pipeline(facts, self._detector, clock_bound_s)
        self._side_by_side = (
            SideBySide(self.pipeline, settings.workers)
            if settings.workers > 1 and not self._detector.remembers
            else None
        )

        def open_it() -> FrameSource:
            return open_source(camera, colour=self._detector.colour, stop=self._stop, date=date)

        self.reader = Reader(camera.id, open_it, live=is_live(camera), lossless=is_lossless(camera))
        self._misfit: ConfigError | None = None
        self._started_s = 0.0
        self._done = False

    def start(self) -> None:
        """Begin to read and to detect."""
        self._started_s = time.monotonic()
        self.reader.start()
        super().start()

    def _wake(self) -> None:
        self.reader.ask_to_stop()

    def join(self, timeout_s: float) -> bool:
        """Wait for both threads' end; False if a driver holds one."""
        deadline = time.monotonic() + timeout_s
        done = super().join(timeout_s)
        return self.reader.join(max(0.0, deadline - time.monotonic())) and done

    @property
    def failed(self) -> bool:
        """Whether it ended otherwise than by its recording's end or by being told to."""
        return self.error is not None or (self.ended and not self._done)

    def _run(self) -> None:
        if self.camera.cores:
            os.sched_setaffinity(0, self.camera.cores)  # of this thread; its detector's threads inherit nothing
        try:
            self._work()
            self.error = self.reader.state.error if self.reader.finished and not is_live(self.camera) else None
        except SkyfixError as error:
            self.error = error
        finally:
            self.reader.ask_to_stop()
            self._detector.close()
            if self._side_by_side is not None:
                self._side_by_side.close()
        if self.error is not None:
            log.error("%s", self.error)
        self._done = True

    def _work(self) -> None:
        step = self.pipeline.step if self._side_by_side is None else self._side_by_side.step
        while not self._stop.is_set() and not self.reader.finished:
            frame = self.reader.get(FRAME_PATIENCE_S)
            if frame is not None and self._fits(frame):
                for message in step(frame):
                    self._publish(message)
        if self._side_by_side is not None:
            for message in self._side_by_side.flush():
                self._publish(message)

    def _fits(self, frame: Picture) -> bool:
        """Whether a frame is of the lens's size; a live camera's that is not is waited for: it may be starting anew."""
        try:
            self.pipeline.check_size(frame)
        except ConfigError as error:
            if not is_live(self.camera):
                raise
            if self._misfit is None:
                log.error("%s; waiting for the size to come back", error)
            self._misfit = error
            return False
        self._misfit = None
        return True

    def checks(self) -> list[Check]:
        """How the camera and its detector are."""
        return [self._check_camera(), self._check_pace(), check_view(self.camera.id, self.pipeline.view)]

    def _check_camera(self) -> Check:
        name, state = f"camera {self.camera.id}", self.reader.state
        error = self.error or state.error or self._misfit
        if error is not None:
            return Check(name, "fail", f"{error.where}: {error.what}", error.action)
        if self.ended:
            said = "".join(f"; {remark.what}" for remark in state.remarks)
            return Check(
                name, "warn", f"the recording ended after {state.frames} frames{said}", "start again to play another"
            )
        since_s = time.monotonic() - (state.last_monotonic_s or self._started_s)
        limit_s = self.camera.source.timeout_s if state.last_monotonic_s else STARTING_S
        if since_s > limit_s and is_live(self.camera):
            return Check(
                name, "fail", f"no frame for {since_s:.0f} s", "check cable and power; it is opened again by itself"
            )
        return check_frames(name, state, self.pipeline.order)

    def _check_pace(self) -> Check:
        name, state = f"detector {self.camera.id}", self.reader.state
        share = state.dropped / max(1, state.frames + state.dropped)
        if share > DROPS_WARN:
            action = "give it a smaller model or another core, or ask the camera for fewer frames"
            return Check(name, "warn", f"{share:.0%} of the frames were lost: too slow for this camera", action)
        late = self.pipeline.counters().get("detector_late", 0.0) / max(1, state.frames)
        if late > LATE_WARN:
            action = "raise detector.max_crops, or point the camera where less moves"
            return Check(name, "warn", "more moves than is looked at within half a second", action)
        return Check(name, "ok", "keeps up")

    def glance(self) -> tuple[Picture, list[TrackRow], str, str] | None:
        """The newest frame, its rows, the worst level and a line about it; None before the first frame."""
        if self.pipeline.latest is None:
            return None
        bad = max(self.checks(), key=lambda check: SEVERITY[check.level])
        return (*self.pipeline.latest, bad.level, f"{self.camera.id}: {bad.reason}")

    def counters(self) -> dict[str, float]:
        """What this camera did so far, by name."""
        state = self.reader.state
        read = {
            "frames": float(state.frames),
            "frames_dropped": float(state.dropped),
            "source_reopened": float(state.reopened),
        }
        return {**read, **self.pipeline.counters()}


def check_frames(name: str, state: ReaderState, order: Remark | None = None) -> Check:
    """How the frames that come are timed, and what is odd about them."""
    if state.frames == 0:
        return Check(name, "warn", "waiting for the first frame")
    remarks = [*state.remarks, *([order] if order else [])]
    if remarks:
        return Check(name, "warn", "; ".join(one.what for one in remarks), remarks[0].action)
    if state.time_source == "arrival":
        action = "use a camera that stamps its frames, or expect a worse position"
        return Check(name, "warn", "frames are timed by their arrival, 0.1 s uncertain", action)
    return Check(name, "ok", f"frames arrive, timed by {state.time_source}")


def check_view(camera: str, view: ViewWatch) -> Check:
    """Whether the camera still looks where it looked."""
    name = f"view {camera}"
    if view.moves:
        action = 'fix the tripod; for a camera that is meant to move set detector.mode = "full_frame"'
        return Check(name, "fail", "the camera moves again and again", action)
    if view.recent:
        last = view.recent[-1]
        size_px = max(abs(last.du_px), abs(last.dv_px))
        action = "fix the tripod; the base station must calibrate this camera again"
        return Check(name, "warn", f"the camera was bumped or re-aimed: the picture moved by {size_px:.0f} px", action)
    return Check(name, "ok", "the camera stands still")
