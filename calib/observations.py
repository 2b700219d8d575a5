"""What the cameras saw and what is known of them before anything is estimated: the input of every calibration.

Everything is in the units of the wire: raw pixels, stamped UTC nanoseconds, ENU metres about the site's origin.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib.errors import CalibrationError
from edge.common.arrays import Array
from edge.lens import LensModel


@dataclass(frozen=True)
class Observations:
    """One camera's pixel tracks, in time order.

    t_unix_ns: (N,) int64 stamps. pixels: (N, 2) raw. track: (N,) int64 the camera's own track numbers (0: unknown).
    sigma_px: (N,) one sigma a coordinate as the detector says, or None if it says nothing.
    Interpolated rows are not measurements and never get in here.
    Raises CalibrationError if the arrays disagree in length, are not finite or run backwards in time.
    """

    t_unix_ns: NDArray[np.int64]
    pixels: Array
    track: NDArray[np.int64]
    sigma_px: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.t_unix_ns)
        if self.pixels.shape != (n, 2) or self.track.shape != (n,):
            raise CalibrationError("arrays of different length", where="observations", action="give one row each")
        if not np.all(np.isfinite(self.pixels)):
            raise CalibrationError("a pixel is not finite", where="observations", action="drop such rows first")
        if np.any(np.diff(self.t_unix_ns) < 0):
            raise CalibrationError("stamps run backwards", where="observations", action="sort them first")

    def __len__(self) -> int:
        return len(self.t_unix_ns)


@dataclass(frozen=True)
class Frame:
    """Measurements of one camera in one frame: pixels (K, 2), label (K,) its own track numbers, sigma_px (K,).

    width_px: (K,) of the boxes, NaN or None where nobody says.
    """

    camera: str
    t_unix_ns: int
    pixels: Array
    label: NDArray[np.int64]
    sigma_px: Array
    width_px: Array | None = None


@dataclass(frozen=True)
class SiteCamera:
    """What is known of a camera beforehand.

    position_enu: (3,) surveyed metres or None; position_covariance: (3, 3) m^2. clock_bound_s: what the box says its
    UTC is good to, None if it says nothing. readout_s: rolling-shutter time first to last row. up_cam: (3,) the unit
    vector of "up" in the camera frame, if a level told it, with up_sigma_deg.
    """

    id: str
    lens: LensModel
    position_enu: Array | None = None
    position_covariance: Array | None = None
    clock_bound_s: float | None = None
    readout_s: float | None = None
    up_cam: Array | None = None
    up_sigma_deg: float | None = None


@dataclass(frozen=True)
class Scene:
    """A site and what its cameras saw. origin: latitude deg, longitude deg, ellipsoidal height m of the ENU frame."""

    site: str
    origin: tuple[float, float, float]
    cameras: tuple[SiteCamera, ...]
    observations: dict[str, Observations] = field(default_factory=dict)
