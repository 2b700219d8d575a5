"""What looks where nobody has said how: two stages, but whole pictures where the pictures come reduced.

In a camera's second stream a drone is two pixels wide and its motion a fraction of one: too little for differences over
time, while looking at the whole of so small a picture, enlarged too, costs no more than two stages on a large one.
"""

from edge.capture.frame import Picture
from edge.common.arrays import Array
from edge.config import DetectorConfig
from edge.detector.detections import Detections, Detector
from edge.detector.full_scan import FullScan
from edge.detector.look import is_reduced
from edge.detector.mask import Mask
from edge.detector.skyfix import StackDetector, StackNet
from edge.detector.two_stage import TwoStage


class BySize(StackDetector):
    """The detector for the size of the first frame. background, mask: as for TwoStage."""

    def __init__(self, net: StackNet, config: DetectorConfig, *, background: bool, mask: Mask | None = None) -> None:
        super().__init__(net, config)
        self._background = background
        self._mask = mask
        self._chosen: Detector | None = None

    def detect(self, frame: Picture, expected_px: Array) -> Detections:
        """The objects in a frame. expected_px: as for TwoStage."""
        if self._chosen is None:
            self._chosen = self._choose(frame)
        return self._chosen.detect(frame, expected_px)

    def _choose(self, frame: Picture) -> Detector:
        if is_reduced(frame.image):
            return FullScan(self._net, self._config)
        return TwoStage(self._net, self._config, background=self._background, mask=self._mask)

    def counters(self) -> dict[str, float]:
        """What the chosen one did so far."""
        return {} if self._chosen is None else self._chosen.counters()

    def close(self) -> None:
        """End the chosen one's threads."""
        if self._chosen is not None:
            self._chosen.close()
