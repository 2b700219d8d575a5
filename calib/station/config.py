"""What `base-station` may be told: one TOML file, decoded into the frozen structs below.

The hazard is a wrong setting that looks like a working one: an ellipsoidal height sent as sea level draws every
target tens of metres off, and a camera that is spelt differently here than on its box is never heard. So unknown keys
are refused, heights above sea level need the site's own undulation, and every camera is named before it is believed.
"""

from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from edge.common import settings
from edge.common.errors import ConfigError
from edge.common.hosts import is_own
from edge.link.settings import BASE_LINK, LinkSettings
from edge.messages import Name

MIN_CAMERAS: Final = 3  # fewer have no georeference: a line through two tripods leaves roll about it free
MAX_CAMERAS: Final = 32  # bits of TARGET_TRACK_ECEF.camera_mask

Degrees = Annotated[float, Meta(ge=-180, le=180)]
Geodetic = tuple[Annotated[float, Meta(ge=-90, le=90)], Degrees, Annotated[float, Meta(ge=-1000, le=10000)]]
PositiveMetres = Annotated[float, Meta(gt=0, le=1000)]
Port = Annotated[int, Meta(ge=0, le=65535)]


class SiteSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which site this is, and where on the Earth its local frame has its origin."""

    name: Name
    origin: Geodetic | None = None  # latitude deg, longitude deg, ellipsoidal m; None: mean of the surveyed cameras
    undulation_m: Annotated[float, Meta(ge=-120, le=100)] | None = (
        None  # geoid above ellipsoid; a `gcs` endpoint needs it
    )
    survey: str | None = None  # a site.toml with surveyed positions, as `base-station survey` writes it


class CameraSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A camera that is expected. Its order here is its bit in MAVLink's camera masks: append, never insert."""

    id: Name
    position: Geodetic | None = None  # latitude deg, longitude deg, ellipsoidal m of the optical centre
    position_sigma: tuple[PositiveMetres, PositiveMetres, PositiveMetres] = (0.02, 0.02, 0.04)  # m, what RTK gives
    antenna_to_camera_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, east north up, added to a box's own fixes


class ReceiverSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A GNSS receiver on the base, for `base-station survey` with a rover."""

    device: str
    baud: Annotated[int, Meta(ge=4800, le=921600)] = 115200


class CalibrationSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When to solve, and how good a solution must be to be sent from."""

    window_s: Annotated[float, Meta(ge=10, le=36000)] = 900.0  # s of flight kept for solving
    window_rows: Annotated[int, Meta(ge=100, le=200000)] = 6000  # observations a camera kept; thinned evenly beyond
    first_solve_s: Annotated[float, Meta(ge=1, le=600)] = 15.0  # s of shared flight before the first attempt
    resolve_s: Annotated[float, Meta(ge=1, le=36000)] = 60.0  # s between refinements at most; a quick one comes sooner
    max_rms_px: Annotated[float, Meta(gt=0, le=50)] = 4.0  # px: worse is refused
    max_sigma_m: PositiveMetres = 2.0  # m: one sigma of a position in the middle of the flight; worse is refused
    warm_start: bool = True  # begin from the stored network, if it fits what is seen


class TrackingSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How objects are followed. The defaults suit small UAVs and birds at 20 m to 1 km."""

    sigma_px: Annotated[float, Meta(gt=0, le=50)] = 1.0  # px, one sigma, where a detection does not say its own
    reorder_horizon_s: Annotated[float, Meta(ge=0, le=2)] = 0.5  # s a ray may come late and still count
    coast_s: Annotated[float, Meta(gt=0, le=30)] = 2.5  # s without a measurement until a target is lost
    stale_s: Annotated[float, Meta(gt=0, le=60)] = 2.0  # s without a frame until a camera is gone
    min_cameras: Annotated[int, Meta(ge=2, le=8)] = 2  # fewer at the last update: DEGRADED
    max_speed_m_s: Annotated[float, Meta(gt=0, le=1000)] = 80.0
    max_range_m: Annotated[float, Meta(gt=0, le=50000)] = 3000.0


class EndpointSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One receiver of MAVLink.

    url: udp:HOST:PORT (send there), tcp:HOST:PORT (dial), tcpin:HOST:PORT (listen) or serial:DEVICE:BAUD.
    profile: gcs for ground-control programs (ADSB_VEHICLE), ecef for programs that want the covariance.
    """

    url: str
    profile: list[Literal["gcs", "ecef"]]
    rate_hz: Annotated[float, Meta(gt=0, le=200)] = 50.0  # at most so many TARGET_TRACK_ECEF a second and target
    signing_key: str | None = None  # file of 64 hex digits, mode 0600; None: unsigned
    link_id: Annotated[int, Meta(ge=0, le=255)] = 1  # of signed streams; one per endpoint, never changed
    commands_from: list[Annotated[int, Meta(ge=1, le=255)]] = []  # system ids obeyed unsigned; [] and no key: none


class MavlinkSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """MAVLink out. QGroundControl and MAVProxy draw only what carries their vehicle's system id: set it to that."""

    system_id: Annotated[int, Meta(ge=1, le=254)] = 200  # 255 is the ground station's
    adsb_rate_hz: Annotated[float, Meta(ge=0.5, le=5)] = 2.0  # slower expires on maps, faster floods radios
    simulated: bool = False  # marks every target as simulated or replayed
    endpoint: list[EndpointSection] = []


class RecordingSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The recording of everything received and sent."""

    folder: str | None = None  # None: nothing is recorded
    max_file_mb: Annotated[int, Meta(ge=1, le=1_000_000)] = 2000  # then a new file is begun
    min_free_mb: Annotated[int, Meta(ge=1, le=1_000_000)] = 500  # less free on the disk: stop recording, go on tracking


class StatusSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the station tells how it is over HTTP: /status.json, /metrics and, with the extra `page`, the page."""

    host: str = "127.0.0.1"  # another address than this machine's own needs a token
    port: Port | None = 8080  # 0 in the file, None here: no HTTP
    page: bool = True  # the operator's page, in a process of its own that starts when somebody looks
    token_file: str | None = None  # file of 16 characters or more, mode 0600; whoever looks must know them
    tiles: str | None = None  # folder of map tiles, Z/X/Y.png in Web Mercator, for the map's background


class BaseConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of base.toml."""

    site: SiteSection
    camera: list[CameraSection]
    state_folder: str = "/var/lib/skyfix"  # network.toml, counters of starts, signing time: must survive a power cut
    link: LinkSettings = BASE_LINK  # boxes dial in here, or the router that this station dials
    receiver: ReceiverSection | None = None
    calibration: CalibrationSection = CalibrationSection()
    tracking: TrackingSection = TrackingSection()
    mavlink: MavlinkSection = MavlinkSection()
    recording: RecordingSection = RecordingSection()
    status: StatusSection = StatusSection()


def load(path: Path | str) -> BaseConfig:
    """The configuration in a file. Raises ConfigError naming file, key and what is allowed there."""
    config = checked(settings.load(path, BaseConfig), Path(path))
    if config.status.port == 0:  # TOML has no None
        return replace(config, status=replace(config.status, port=None))
    return config


def checked(config: BaseConfig, path: Path) -> BaseConfig:
    """`config` itself, if what no single key shows is right too. Raises ConfigError."""
    ids = [camera.id for camera in config.camera]
    _refuse(len(set(ids)) < len(ids), path, f"camera {_twice(ids)!r} is named twice", "give each [[camera]] its own id")
    _refuse(
        not MIN_CAMERAS <= len(ids) <= MAX_CAMERAS,
        path,
        f"{len(ids)} cameras are named",
        f"name {MIN_CAMERAS} to {MAX_CAMERAS} as [[camera]]",
    )
    gcs = [endpoint.url for endpoint in config.mavlink.endpoint if "gcs" in endpoint.profile]
    _refuse(
        bool(gcs) and config.site.undulation_m is None,
        path,
        f"endpoint {gcs[:1]} has profile gcs, whose heights are above sea level, but site.undulation_m is not set",
        "set [site] undulation_m to the geoid's height above the ellipsoid there (EGM96), in metres",
    )
    _refuse(
        not config.link.listen and not config.link.connect,
        path,
        "[link] neither listens nor connects",
        'give listen = ["tcp/HOST:7447"] for boxes to dial, or leave [link] out',
    )
    host = config.status.host
    _refuse(
        not is_own(host) and config.status.token_file is None,
        path,
        f"status.host {host} can be reached by others, and there is no token",
        'give status.token_file, made with `openssl rand -hex 16`, or leave host at "127.0.0.1"',
    )
    urls = [endpoint.url for endpoint in config.mavlink.endpoint]
    _refuse(
        len(set(urls)) < len(urls),
        path,
        f"endpoint {_twice(urls)!r} is given twice",
        "give it once, with both profiles",
    )
    return config


def _twice(names: list[str]) -> str:
    return next((name for name in names if names.count(name) > 1), "")


def _refuse(wrong: bool, path: Path, what: str, action: str) -> None:
    if wrong:
        raise ConfigError(what, where=str(path), action=action)
