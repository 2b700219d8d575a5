"""The shipped model on every whole frame: for a camera that moves, where differences over time say nothing."""

import numpy as np

from edge.capture.frame import Picture
from edge.common.arrays import Array
from edge.config import DetectorConfig
from edge.detector.detections import Detections
from edge.detector.history import History
from edge.detector.look import look
from edge.detector.skyfix import StackDetector, StackNet


class FullScan(StackDetector):
    """A skyfix model over each whole frame, as it is and, if it was reduced, enlarged."""

    def __init__(self, net: StackNet, config: DetectorConfig) -> None:
        super().__init__(net, config)
        self._history = History(net.past_s)
        self._frames = 0

    def detect(self, frame: Picture, expected_px: Array) -> Detections:
        """The objects in a frame; `expected_px` is not needed here."""
        self._frames += 1
        self._history.push(frame)
        found = look(self._net, [frame.image, *self._history.past()], self._config.score_min)
        return found.where(np.arange(len(found))[: self._config.max_detections])

    def counters(self) -> dict[str, float]:
        """Frames looked at."""
        return {"detector_frames": float(self._frames)}

    def close(self) -> None:
        """Nothing to end."""
