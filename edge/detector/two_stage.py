"""Two stages for a camera that stands still: motion and memory say where, a small network says what and exactly where.

Every frame: where tracks are expected, where the last full scan saw something, and where something moved, small crops
are cut at native resolution from now and the recent past, and judged in one batch. Their findings are merged, never
replaced: a full scan only ever adds places to look at.
"""

from typing import Final

import numpy as np

from edge.capture.frame import Image, Picture
from edge.common.arrays import Array
from edge.config import DetectorConfig
from edge.detector.crops import Crop, add, cut, in_frame
from edge.detector.detections import Detections, nothing
from edge.detector.history import History
from edge.detector.look import SAME_OBJECT_IOU
from edge.detector.mask import Mask
from edge.detector.motion import NO_BLOBS, MotionDetector
from edge.detector.nms import suppress
from edge.detector.scan import Scanner
from edge.detector.skyfix import StackDetector, StackNet
from edge.detector.turns import Turns

RESERVED_SHARE: Final = 3  # a third of max_crops stays for what is not followed yet; all of it when some wait
FOLLOWED_TIMES: Final = 4  # times max_crops that tracks may take: a crop costs a millisecond, a lost track a target


class TwoStage(StackDetector):
    """The detector for static cameras. background: run full scans beside the frames, not within them. mask: where it
    need not look."""

    def __init__(self, net: StackNet, config: DetectorConfig, *, background: bool, mask: Mask | None = None) -> None:
        super().__init__(net, config)
        self._history = History(net.past_s)
        self._mask = mask
        self._motion = MotionDetector(None if mask is None else mask.raster)
        self._scanner = Scanner(net, config.score_min, config.scan_period_s, background=background)
        self._turns, self._track_turns = Turns(), Turns()
        self._last_t_unix_ns = 0
        self._counts = {"detector_frames": 0.0, "detector_crops": 0.0, "detector_all_moving": 0.0}

    def detect(self, frame: Picture, expected_px: Array) -> Detections:
        """The objects in a frame. expected_px: `(M, 3)` of u, v, extent where tracks are expected."""
        if self._history.push(frame):
            self._motion.forget()
        past = self._history.past()
        images = [frame.image, *past]
        interval_s = max(0.0, (frame.t_unix_ns - self._last_t_unix_ns) / 1e9)
        self._last_t_unix_ns = frame.t_unix_ns
        blobs = self._motion.propose(frame.image, past, interval_s) if self._history.complete else NO_BLOBS
        self._scanner.offer(frame.t_unix_ns, images)
        moving = np.concatenate([self._scanner.take(), np.column_stack([blobs.centre_px, blobs.extent_px])])
        if self._mask is not None:
            moving = moving[~self._mask.covers(moving)]
        crops = self._crops(frame, expected_px.reshape(-1, 3), moving)
        self._counts["detector_frames"] += 1
        self._counts["detector_crops"] += len(crops)
        self._counts["detector_all_moving"] += blobs.share > 0 and not len(blobs.strength)
        found = self._judge(frame, images, crops)
        self._turns.find(found.centre_px, frame.t_unix_ns)
        return found

    def _crops(self, frame: Picture, expected: Array, moving: Array) -> list[Crop]:
        """Where to look: at all that is followed, within reason, and at what else moves, in turns if it is too much."""
        limit = self._config.max_crops
        crops, seen = add([], expected, frame.size_px, FOLLOWED_TIMES * limit)
        # More tracks than may be looked at: in turns, and their gate bridges the frames between.
        if seen < len(expected):
            expected = self._track_turns.order(expected, frame.t_unix_ns)
            crops, seen = add([], expected, frame.size_px, FOLLOWED_TIMES * limit)
            self._track_turns.look(expected, seen, frame.t_unix_ns)
        more = limit if self._turns.pressed(frame.t_unix_ns) else max(1, limit // RESERVED_SHARE)
        room = max(limit, len(crops) + more)
        together, seen = add(crops, moving, frame.size_px, room)
        if seen == len(moving):
            self._turns.look(moving, seen, frame.t_unix_ns)
            return together
        ordered = self._turns.order(moving, frame.t_unix_ns)
        together, seen = add(crops, ordered, frame.size_px, room)
        self._turns.look(ordered, seen, frame.t_unix_ns)
        return together

    def _judge(self, frame: Picture, images: list[Image], crops: list[Crop]) -> Detections:
        if not crops:
            return nothing(len(self.class_names))
        found, index = self._net.run_together(cut(images, crops), self._config.score_min)
        merged = in_frame(found, crops, index, frame.size_px)
        keep = suppress(merged.centre_px, merged.size_px, merged.score, SAME_OBJECT_IOU)
        return merged.where(keep[: self._config.max_detections])

    def counters(self) -> dict[str, float]:
        """Frames, crops and scans so far."""
        return {**self._counts, "detector_scans": float(self._scanner.scans), "detector_late": float(self._turns.late)}

    def close(self) -> None:
        """End the scanning thread."""
        self._scanner.close()
