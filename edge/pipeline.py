"""One camera's work: a frame goes in, messages come out. No thread, no socket, no clock.

The hazards are at the seams. A lens file of another resolution gives rays that look right and are wrong; a clock that
was set back gives stamps that overtake themselves; a pixel that the lens cannot explain gives no ray at all. The first
is refused with a word about it, the others are left out and counted.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from typing import Final

import numpy as np

from edge.capture.frame import OF_THIS_BOX, Picture, Remark
from edge.common.arrays import Array
from edge.common.errors import ConfigError
from edge.config import GateConfig
from edge.detector.detections import Detections, Detector
from edge.gate import Gate, TrackRow, make_gate
from edge.lens import LensModel, pixel_to_ray
from edge.messages import MAX_PIXEL, MAX_RAY, Detection, Tracks
from edge.pictures.view import ViewWatch

EMPTY_EVERY_NS: Final = 500_000_000  # "sees nothing" is said twice a second; the contract asks for once
STEPPED_BACK_NS: Final = 1_000_000_000  # further back than this the clock was set, and tracking begins anew
COUNTED: Final = ("frames_backwards", "rows_without_ray", "rows_unsound", "rows_published", "clock_stepped")
BACKWARDS_WARN: Final = 0.02  # share of frames without a later time than the one before, that is said
NOWHERE: Final = np.zeros((0, 3))


@dataclass(frozen=True)
class CameraFacts:
    """What stays the same about a camera."""

    id: str
    lens: LensModel
    readout_s: float | None
    gate: GateConfig
    epoch: int


class Pipeline:
    """Detection, gating and undistortion of one camera. clock_bound_s: how far this box's UTC may be off, now."""

    def __init__(self, facts: CameraFacts, detector: Detector, clock_bound_s: Callable[[], float | None]) -> None:
        self._facts = facts
        self._detector = detector
        self._clock_bound_s = clock_bound_s
        self._gate = self._new_gate(1)
        self._seq = self._in_order = 0
        self._last_t_unix_ns: int | None = None
        self._last_said_unix_ns = 0
        self._bound_s: float | None = None
        self._counts = dict.fromkeys(COUNTED, 0.0)
        self.view = ViewWatch()
        self.latest: tuple[Picture, list[TrackRow]] | None = None

    def _new_gate(self, first_track: int) -> Gate:
        return make_gate(self._facts.gate, self._facts.lens.size_px, self._detector.track_score, first_track)

    def step(self, frame: Picture) -> list[Tracks]:
        """The messages that one more frame decides. Raises ConfigError if the lens is of another resolution."""
        if not self._accept(frame):
            return []
        return self.conclude(frame, self._detector.detect(frame, self._gate.expected(frame.t_unix_ns)))

    def look(self, frame: Picture) -> Detections:
        """Detection alone, for detectors that remember nothing: several frames may be looked at side by side."""
        self.check_size(frame)
        return self._detector.detect(frame, NOWHERE)

    def conclude(self, frame: Picture, found: Detections) -> list[Tracks]:
        """Gating and undistortion of what was found in a frame, frames in order."""
        rows = self._gate.step(frame.t_unix_ns, found)
        self.view.update(frame)
        self.latest = (frame, rows)
        return self._messages(frame, rows)

    def _accept(self, frame: Picture) -> bool:
        self.check_size(frame)
        return self.in_order(frame)

    def in_order(self, frame: Picture) -> bool:
        """Whether a frame is later than the one before; one that is not is counted and left out."""
        last = self._last_t_unix_ns
        if last is not None and frame.t_unix_ns <= last:
            if frame.t_unix_ns > last - STEPPED_BACK_NS:
                self._counts["frames_backwards"] += 1
                return False
            self._counts["clock_stepped"] += 1
            self._gate = self._new_gate(self._gate.next_track)
        self._last_t_unix_ns = frame.t_unix_ns
        self._in_order += 1
        return True

    @property
    def order(self) -> Remark | None:
        """What is odd about the order of the frames so far; None if nothing is."""
        backwards = self._counts["frames_backwards"]
        if backwards <= BACKWARDS_WARN * (backwards + self._in_order):
            return None
        said = f"{backwards:.0f} of {backwards + self._in_order:.0f} frames have no later time than the one before"
        action = "ask the camera for its stream directly, or restart what passes it on"
        return Remark(f"{said} and are left out", action)

    def check_size(self, frame: Picture) -> None:
        """Raises ConfigError if a frame is of another size than the lens was measured at."""
        if frame.size_px != self._facts.lens.size_px:
            width, height = self._facts.lens.size_px
            raise ConfigError(
                f"the lens was measured at {width} x {height}, the frames are {frame.size_px[0]} x {frame.size_px[1]}",
                where=f"camera {self._facts.id}",
                action="ask the camera for the lens's resolution (source.size_px), or measure the lens at the frames'",
            )

    def _messages(self, frame: Picture, rows: list[TrackRow]) -> list[Tracks]:
        self._bound_s = total_bound_s(frame, self._clock_bound_s())
        seen = sorted(self._with_rays(rows), key=lambda pair: pair[0].t_unix_ns)
        by_time = groupby(seen, key=lambda pair: pair[0].t_unix_ns)
        messages = [
            self._tracks(t, [self._detection(*pair) for pair in same], late=t < frame.t_unix_ns) for t, same in by_time
        ]
        if messages:
            self._last_said_unix_ns = frame.t_unix_ns
        elif not 0 <= frame.t_unix_ns - self._last_said_unix_ns < EMPTY_EVERY_NS:
            self._last_said_unix_ns = frame.t_unix_ns
            messages = [self._tracks(frame.t_unix_ns, [])]
        return messages

    def _tracks(self, t_unix_ns: int, detections: list[Detection], *, late: bool = False) -> Tracks:
        self._seq += 1
        return Tracks(
            t_unix_ns=t_unix_ns,
            seq=self._seq,
            epoch=self._facts.epoch,
            clock_bound_s=self._bound_s,
            size_px=self._facts.lens.size_px,
            readout_s=self._facts.readout_s,
            detections=detections,
            late=late,
        )

    def _with_rays(self, rows: list[TrackRow]) -> list[tuple[TrackRow, Array]]:
        """Rows with their rays; those that the lens has no ray for are left out and counted."""
        if not rows:
            return []
        rays = pixel_to_ray(self._facts.lens, np.array([(row.u_px, row.v_px) for row in rows]))
        usable = np.all(np.isfinite(rays) & (np.abs(rays) < MAX_RAY), axis=1)
        sound = np.array([is_sound(row) for row in rows])
        self._counts["rows_unsound"] += int((~sound).sum())
        usable &= sound
        self._counts["rows_without_ray"] += int((~usable).sum())
        self._counts["rows_published"] += int(usable.sum())
        return [(row, ray) for row, ray, good in zip(rows, rays, usable.tolist(), strict=True) if good]

    def _detection(self, row: TrackRow, ray: Array) -> Detection:
        names = self._detector.class_names
        classes = {name: round(score, 4) for name, score in zip(names, row.classes, strict=False)}
        return Detection(
            track=row.track,
            u_px=round(row.u_px, 4),
            v_px=round(row.v_px, 4),
            ray_x=float(ray[0]),
            ray_y=float(ray[1]),
            width_px=round(row.width_px, 3),
            height_px=round(row.height_px, 3),
            score=round(row.score, 4),
            sigma_px=None if row.sigma_px is None else max(round(row.sigma_px, 4), 1e-3),
            classes=classes or None,
            status=row.status,
        )

    def counters(self) -> dict[str, float]:
        """What this camera did so far, by name; every number only grows."""
        return {
            **self._counts,
            **self._detector.counters(),
            "messages": float(self._seq),
            "view_shifts": float(self.view.shifts),
        }


def is_sound(row: TrackRow) -> bool:
    """Whether a row may be published: what messages.Detection allows of sizes, scores and pixels."""
    sizes = 0 <= row.width_px <= MAX_PIXEL and 0 <= row.height_px <= MAX_PIXEL  # false of NaN too
    return sizes and 0 <= row.score <= 1 and abs(row.u_px) <= MAX_PIXEL and abs(row.v_px) <= MAX_PIXEL


def total_bound_s(frame: Picture, clock_bound_s: float | None) -> float | None:
    """How far a frame's time may be from UTC: its own bound, and this box's clock where it was stamped by that."""
    if frame.bound_s is None:
        return None
    if frame.time_source not in OF_THIS_BOX:
        return frame.bound_s
    return None if clock_bound_s is None else frame.bound_s + clock_bound_s


class SideBySide:
    """Looks at several frames at once, in threads, and concludes them in order. For detectors that remember nothing."""

    def __init__(self, pipeline: Pipeline, workers: int) -> None:
        self._pipeline = pipeline
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="detect")
        self._under_way: list[tuple[Picture, Future[Detections]]] = []
        self._workers = workers

    def step(self, frame: Picture) -> list[Tracks]:
        """Begin a frame; the messages of those that are done, waiting if every worker is busy."""
        if self._pipeline.in_order(frame):
            self._under_way.append((frame, self._pool.submit(self._pipeline.look, frame)))
        return self._conclude(self._workers)

    def flush(self) -> list[Tracks]:
        """The messages of all frames begun."""
        return self._conclude(0)

    def _conclude(self, allowed: int) -> list[Tracks]:
        messages = []
        while self._under_way and (len(self._under_way) > allowed or self._under_way[0][1].done()):
            frame, future = self._under_way.pop(0)
            messages += self._pipeline.conclude(frame, future.result())
        return messages

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown(wait=True, cancel_futures=True)
