"""How the station is, as one struct: /status.json, /metrics, the operator's page and TRACKER_STATUS all say the same.

The hazard is two truths: a page that is green while the metrics are red. So everything that tells of the station's
state is made from this struct, and the struct is made in one place (status/snapshot.py).
"""

import msgspec

from calib.reference_frame import UNKNOWN_LABEL
from edge.messages import Health, HealthItem


class CameraStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One camera. suspect: why it is left out, empty if it is not. muted: the operator left it out.

    centre_enu: where its survey says it is, None if it does not. receiver: what its box says of its RTK receiver.
    """

    id: str
    online: bool
    present: bool
    last_frame_s: float | None
    detections_per_frame: float
    clock_bound_s: float | None
    clock_offset_s: float | None
    surveyed: bool
    calibrated: bool
    suspect: str
    missed: int
    reason: str
    muted: bool = False
    centre_enu: tuple[float, float, float] | None = None
    receiver: HealthItem | None = None
    counters: dict[str, int]


class PairStatus(msgspec.Struct, frozen=True, kw_only=True):
    """Two cameras: seconds both saw something, and the raw residual between them now, if it is watched."""

    one: str
    other: str
    shared_s: int
    residual_mrad: float | None


class TargetStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One target on the map: ENU metres about the origin, WGS 84 degrees, ellipsoidal height."""

    track: int
    state: str
    enu_m: tuple[float, float, float]
    velocity_enu_m_s: tuple[float, float, float]
    covariance_enu_m2: tuple[float, ...]  # row-major upper triangle of the 3 x 3
    geodetic: tuple[float, float, float]
    cameras: list[str]
    age_s: float
    sigma_m: float


class EndpointStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One receiver of an output. output: which, e.g. mavlink. content: what it gets, in a word or two."""

    output: str = "mavlink"
    url: str
    content: str = ""
    sent: int
    sent_bytes: int
    errors: int
    last_error: str


class StationStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The whole station. sigma_m: of the calibration's positions, within the site."""

    site: str
    version: str
    epoch: int
    t_unix_ns: int
    uptime_s: float
    phase: str
    reason: str
    action: str
    first_solve_s: float  # of flight that two cameras must share before the first attempt
    origin: tuple[float, float, float] | None
    frame: str = UNKNOWN_LABEL  # reference frame of the cameras' positions, and so of all that is sent
    frame_sigma_m: float = 0.0  # what that adds to every position's sigma: the targets' hold it, sigma_m does not
    network: str | None  # fingerprint
    rms_px: float | None
    sigma_m: float | None
    solving: bool
    cameras: list[CameraStatus]
    pairs: list[PairStatus]
    targets: list[TargetStatus]
    tentative: int
    latency_ms: tuple[float, float] | None  # median and 99th percentile, message received to MAVLink sent
    endpoints: list[EndpointStatus]
    recording: str | None
    recording_folder: str | None = None
    free_mb: int | None = None  # on the recording's disk
    health: Health
    counters: dict[str, float]
