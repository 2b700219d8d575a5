"""What a source hands on: an image, when it was exposed, and how far that may be wrong.

The hazard is the arrival time. A frame is decoded 30 to 300 ms after its light fell, by an amount that changes with the
load, and at 20 m/s each 50 ms is a metre. So a frame says where its time comes from and how far it may be off, and the
time is always the middle of the exposure of its first row.
"""

from dataclasses import dataclass
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

# file: given by whoever recorded it. sensor: the driver's stamp, in the box's clock. sender: the camera's own clock.
# arrival: when it came in, the least delayed frames taken as the measure; the last resort.
TimeSource = Literal["file", "sensor", "sender", "arrival"]
OF_THIS_BOX: Final = frozenset({"sensor", "arrival"})  # sources whose times are no better than the box's clock

StampOf = Literal["middle", "exposure_start", "exposure_end", "frame_end"]


@dataclass(frozen=True)
class Picture:
    """One image. image: `(H, W)` grey or `(H, W, 3)` BGR. bound_s: how far t_unix_ns may be off, beside the box's clock
    where the source is of this box; None if nobody knows. segment: grows when the stream began anew."""

    t_unix_ns: int
    image: Image
    time_source: TimeSource
    bound_s: float | None = None
    segment: int = 0

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.image.shape[1], self.image.shape[0]


@dataclass(frozen=True)
class Remark:
    """What the operator should know of a source that works: what is odd about it, and what to do."""

    what: str
    action: str


class FrameSource(Protocol):
    """Something frames come out of, one after the other."""

    live: bool
    """Live sources are reopened when they fail, and only the newest frame matters."""

    @property
    def skipped(self) -> int:
        """Frames passed over inside the source because they came too late."""

    @property
    def remarks(self) -> list[Remark]:
        """What is to be known of it, so far."""

    def read(self) -> Picture | None:
        """The next frame, None at the end. Raises SourceError if the source is dead."""

    def close(self) -> None:
        """Let go of the device or file."""


def middle_of_exposure(t_ns: int, stamp_of: StampOf, exposure_s: float, readout_s: float) -> int:
    """The middle of the first row's exposure, from a stamp of some other instant of the frame."""
    offset_s = {
        "middle": 0.0,
        "exposure_start": exposure_s / 2,
        "exposure_end": -exposure_s / 2,
        "frame_end": -(readout_s + exposure_s / 2),
    }[stamp_of]
    return t_ns + round(offset_s * 1e9)


@dataclass(frozen=True)
class StampRule:
    """Which instant of a frame a camera's stamps are of, and by how much each is late; seconds."""

    stamp_of: StampOf = "middle"
    exposure_s: float = 0.0
    readout_s: float = 0.0
    delay_s: float = 0.0

    def middle_ns(self, t_ns: int) -> int:
        """The middle of the first row's exposure, from a frame's stamp."""
        return middle_of_exposure(t_ns - round(self.delay_s * 1e9), self.stamp_of, self.exposure_s, self.readout_s)


AS_STAMPED: Final = StampRule()  # of a camera that stamps the middle, and at once
