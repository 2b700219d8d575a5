"""How the station is, as one struct: /status.json, /metrics, the operator's page and TRACKER_STATUS all say the same.

The hazard is two truths: a page that is green while the metrics are red. So everything that tells of the station's
state is made from this struct, and the struct is made in one place (calib/station/core/station.py).
"""

from collections.abc import Iterator

import msgspec

from calib.station.core.calibration import Phase
from edge.messages import Health


class CameraStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One camera. suspect: why it is left out, empty if it is not. muted: the operator left it out.

    centre_enu: where its survey says it is, None if it does not.
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
    """The whole station."""

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


def prometheus(status: StationStatus) -> str:
    """The struct in Prometheus' text format (version 0.0.4)."""
    return "\n".join(_lines(status)) + "\n"


def _lines(status: StationStatus) -> Iterator[str]:
    yield from _one("up_seconds", "counter", status.uptime_s)
    yield from _one("starts", "counter", status.epoch)
    yield "# TYPE skyfix_phase gauge"
    for phase in Phase:
        yield f'skyfix_phase{{phase="{phase}"}} {int(status.phase == phase)}'
    yield from _one("targets", "gauge", len(status.targets))
    yield from _one("targets_tentative", "gauge", status.tentative)
    if status.rms_px is not None:
        yield from _one("calibration_rms_px", "gauge", status.rms_px)
    if status.latency_ms is not None:
        yield "# TYPE skyfix_latency_seconds gauge"
        for quantile, milliseconds in zip(("0.5", "0.99"), status.latency_ms, strict=True):
            yield f'skyfix_latency_seconds{{quantile="{quantile}"}} {milliseconds / 1e3:.6f}'
    yield from _per_camera(status)
    yield "# TYPE skyfix_health gauge"
    for item in status.health.items:
        yield f'skyfix_health{{name="{_escaped(item.name)}"}} {("ok", "warn", "fail").index(item.level)}'
    for name, value in sorted(status.counters.items()):
        yield from _one(f"{name}_total", "counter", value)


def _per_camera(status: StationStatus) -> Iterator[str]:
    yield "# TYPE skyfix_camera_online gauge"
    yield from (f'skyfix_camera_online{{camera="{c.id}"}} {int(c.online)}' for c in status.cameras)
    yield "# TYPE skyfix_camera_calibrated gauge"
    yield from (f'skyfix_camera_calibrated{{camera="{c.id}"}} {int(c.calibrated)}' for c in status.cameras)
    yield "# TYPE skyfix_camera_missed_total counter"
    yield from (f'skyfix_camera_missed_total{{camera="{c.id}"}} {c.missed}' for c in status.cameras)


def _one(name: str, kind: str, value: float) -> Iterator[str]:
    yield f"# TYPE skyfix_{name} {kind}"
    yield f"skyfix_{name} {value:g}"


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
