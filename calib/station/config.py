"""What `base-station` may be told: one TOML file, decoded into the frozen structs below.

The hazard is a wrong setting that looks like a working one: an ellipsoidal height sent as sea level draws every
target tens of metres off, and a camera that is spelt differently here than on its box is never heard. So unknown keys
are refused, heights above sea level need the site's own undulation, and every camera is named before it is believed.
"""

from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from calib.reference_frame import UNKNOWN_LABEL
from calib.tracking.options import TrackerOptions
from edge.clock.settings import ClockConfig
from edge.common import settings
from edge.common.errors import ConfigError
from edge.common.hosts import is_own
from edge.gnss.settings import ReceiverSettings
from edge.link.settings import BASE_LINK, LinkSettings
from edge.messages import Name

TRACKER: Final = TrackerOptions()
MIN_CAMERAS: Final = 3  # fewer have no georeference: a line through two tripods leaves roll about it free
MAX_CAMERAS: Final = 32  # bits of TARGET_TRACK_ECEF.camera_mask

Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Height = Annotated[float, Meta(ge=-1000, le=10000)]
Geodetic = tuple[Latitude, Longitude, Height]
PositiveMetres = Annotated[float, Meta(gt=0, le=1000)]
SystemId = Annotated[int, Meta(ge=1, le=255)]
Sigmas = tuple[PositiveMetres, PositiveMetres, PositiveMetres]  # one sigma east, north, up
# m, of a position that comes without a sigma: what one hurried occupation through a network is good for, the antenna's
# height included (twice the 2 cm that it scatters by). Too wide a sigma costs a little; too narrow a one is believed.
UNSTATED_SIGMA_M: Final = (0.05, 0.05, 0.1)


class SiteSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which site this is, and where on the Earth its local frame has its origin."""

    name: Annotated[Name, Meta(description="the same on every box")]
    origin: Annotated[
        Geodetic | None,
        Meta(description="latitude and longitude in degrees, ellipsoidal metres; left out: mean of the cameras"),
    ] = None
    frame: Annotated[
        str,
        Meta(
            description="reference frame of the positions in this file, such as ETRS89 or EPSG:9989; while it is not"
            " known, 1 m is added to the sigma of what is sent"
        ),
    ] = UNKNOWN_LABEL
    undulation_m: Annotated[
        Annotated[float, Meta(ge=-120, le=100)] | None,
        Meta(description="geoid (EGM96) above ellipsoid there; an endpoint of profile `gcs` needs it"),
    ] = None
    survey: Annotated[
        str | None,
        Meta(
            description="what `base-station survey` writes, or a site.toml; left out: survey.toml beside this file,"
            " if it is there"
        ),
    ] = None


class CameraSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A camera that is expected. Its order here is its bit in MAVLink's camera masks: append, never insert."""

    # Both homes of one offset filled would take it off twice: so the base has none, and says where it went.
    MOVED: ClassVar[dict[str, tuple[str, str]]] = {
        "antenna_to_camera_m": (
            "is no key of the base any more: the offset between antenna and lens has one home, gnss.lever_arm_m in "
            "the edge.toml of the camera's box",
            "take it out here and give lever_arm_m there, under [gnss]: antenna minus lens, so the same numbers with "
            "the opposite sign. If the box has it already, only take it out here",
        )
    }

    id: Annotated[Name, Meta(description="as its box has it")]
    position: Annotated[
        Geodetic | None,
        Meta(
            description="optical centre: latitude and longitude in degrees, ellipsoidal metres;"
            " left out: the survey's, or else the box's own fixes"
        ),
    ] = None
    position_sigma: Annotated[
        Sigmas,
        Meta(description="one sigma of position in metres: east, north, up; the default is a hurried RTK position's"),
    ] = UNSTATED_SIGMA_M


class ReceiverSection(ReceiverSettings, frozen=True, kw_only=True):
    """A GNSS receiver on the base, for `base-station survey` with a rover: read as a box reads its own."""


class CalibrationSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When to solve, and how good a solution must be to be sent from."""

    window_s: Annotated[float, Meta(ge=10, le=36000, description="of flight kept for solving")] = 900.0
    window_rows: Annotated[
        int, Meta(ge=100, le=200000, description="observations a camera kept; thinned evenly beyond")
    ] = 6000
    first_solve_s: Annotated[float, Meta(ge=1, le=600, description="of shared flight before the first attempt")] = 15.0
    resolve_s: Annotated[
        float, Meta(ge=1, le=36000, description="between refinements at most; a quick one comes sooner")
    ] = 60.0
    max_rms_px: Annotated[float, Meta(gt=0, le=50, description="a solution with a larger residual is refused")] = 4.0
    max_sigma_m: Annotated[
        PositiveMetres,
        Meta(description="one sigma of a position in the middle of the flight; a larger one is refused"),
    ] = 2.0
    warm_start: Annotated[bool, Meta(description="begin from the stored network, if it fits what is seen")] = True


class TrackingSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How objects are followed. The defaults suit small UAVs and birds at 20 m to 3 km."""

    sigma_px: Annotated[float, Meta(gt=0, le=50, description="one sigma of a detection that does not say its own")] = (
        1.0
    )
    reorder_horizon_s: Annotated[float, Meta(ge=0, le=2, description="a ray may come so late and still count")] = (
        TRACKER.reorder_horizon_s
    )
    coast_s: Annotated[float, Meta(gt=0, le=30, description="without a measurement for so long a target is lost")] = (
        TRACKER.coast_s
    )
    stale_s: Annotated[float, Meta(gt=0, le=60, description="without a frame for so long a camera is gone")] = 2.0
    min_cameras: Annotated[
        int,
        Meta(
            ge=2,
            le=8,
            description="a target that fewer saw at its last update is marked DEGRADED; "
            "3 marks all that one lying camera can put where it likes",
        ),
    ] = 2
    max_speed_m_s: Annotated[float, Meta(gt=0, le=1000, description="a faster object does not become a target")] = (
        TRACKER.limits.max_speed_m_s
    )
    max_range_m: Annotated[
        float, Meta(gt=0, le=50000, description="an object farther from its cameras does not become a target")
    ] = TRACKER.limits.max_range_m
    max_sigma_m: Annotated[
        float, Meta(gt=0, le=1000, description="a position with a larger sigma, along its worst axis, is not sent")
    ] = TRACKER.max_sigma_m
    max_sigma_share: Annotated[
        float,
        Meta(
            gt=0,
            le=1,
            description="of the range from the nearest camera: the same for what is near; 6 m are always allowed",
        ),
    ] = TRACKER.max_sigma_share


class EndpointSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One receiver of MAVLink."""

    url: Annotated[
        str,
        Meta(
            min_length=1,
            description="udp:HOST:PORT (send there), tcp:HOST:PORT (dial), tcpin:HOST:PORT (listen)"
            " or serial:DEVICE:BAUD",
        ),
    ]
    profile: Annotated[
        list[Literal["gcs", "ecef"]],
        Meta(description="gcs for ground-control programs (ADSB_VEHICLE), ecef for programs that want the covariance"),
    ]
    rate_hz: Annotated[
        float, Meta(gt=0, le=200, description="at most so many TARGET_TRACK_ECEF a second and target")
    ] = 50.0
    signing_key: Annotated[str | None, Meta(description="file of 64 hex digits, mode 0600; left out: unsigned")] = None
    link_id: Annotated[
        int, Meta(ge=0, le=255, description="of signed streams; one for each endpoint, never changed")
    ] = 1
    commands_from: Annotated[
        list[SystemId], Meta(description="system ids obeyed unsigned; none of them and no key: none")
    ] = []


class MavlinkSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """MAVLink out. QGroundControl and MAVProxy draw only what carries their vehicle's system id: set it to that."""

    system_id: Annotated[int, Meta(ge=1, le=254, description="of all that is sent; 255 is the ground station's")] = 200
    gcs_component: Annotated[
        Annotated[int, Meta(ge=1, le=255)] | None,
        Meta(description="component id of what profile gcs sends; left out: told from site, folder and machine"),
    ] = None
    ecef_component: Annotated[
        Annotated[int, Meta(ge=1, le=255)] | None,
        Meta(description="component id of what profile ecef sends; left out: told from site, folder and machine"),
    ] = None
    icao_first: Annotated[
        Annotated[int, Meta(ge=1, le=16129)] | None,
        Meta(
            description="first of the 255 addresses that targets are drawn under; left out: told as the component ids"
        ),
    ] = None
    callsign: Annotated[
        Annotated[str, Meta(pattern="^[A-Z0-9]{1,4}$")] | None,
        Meta(description="what targets' callsigns begin with; left out: told as the component ids"),
    ] = None
    adsb_rate_hz: Annotated[
        float, Meta(ge=0.5, le=5, description="ADSB_VEHICLE a second: slower expires on maps, faster floods radios")
    ] = 2.0
    simulated: Annotated[bool, Meta(description="marks every target as simulated or replayed")] = False
    endpoint: list[EndpointSection] = []


class RecordingSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The recording of everything received and sent."""

    folder: Annotated[str | None, Meta(description="left out: nothing is recorded")] = None
    max_file_mb: Annotated[
        int,
        Meta(
            ge=1,
            le=1_000_000,
            description="megabytes before it is compressed, then a new file is begun; 200: 80 minutes",
        ),
    ] = 200
    compress: Annotated[
        bool, Meta(description="make finished files small (zstd); the one that is written is as it comes")
    ] = True
    when_full: Annotated[
        Literal["oldest_out", "stop"],
        Meta(description="what goes when room runs out: the oldest recording of this site, or what comes next"),
    ] = "oldest_out"
    max_total_mb: Annotated[
        Annotated[int, Meta(ge=10, le=100_000_000)] | None,
        Meta(description="megabytes of this site's recordings, then the oldest goes; left out: as the disk allows"),
    ] = None
    min_free_mb: Annotated[
        int,
        Meta(
            ge=1,
            le=1_000_000,
            description="megabytes; less free on the disk: room is made, or recording stops; tracking goes on",
        ),
    ] = 500


class StatusSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the station tells how it is over HTTP: /status.json, /metrics and, with the extra `page`, the page."""

    host: Annotated[str, Meta(min_length=1, description="another address than this machine's own needs a token")] = (
        "127.0.0.1"
    )
    port: Annotated[Annotated[int, Meta(ge=0, le=65535)] | None, Meta(description="0: no HTTP")] = 8080
    page: Annotated[
        bool, Meta(description="the operator's page, in a process of its own that starts when somebody looks")
    ] = True
    token_file: Annotated[
        str | None,
        Meta(description="file of 16 characters or more, mode 0600; whoever looks must know them"),
    ] = None
    tls: Annotated[
        bool,
        Meta(description="serve over HTTPS, with the certificate of [link.tls]; browsers must know its authority.pem"),
    ] = False
    tiles: Annotated[
        str | None, Meta(description="folder of map tiles, Z/X/Y.png in Web Mercator, for the map's background")
    ] = None


class BaseConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of base.toml."""

    site: SiteSection
    camera: Annotated[list[CameraSection], Meta(description="one [[camera]] each, at least three")]
    state_folder: Annotated[
        str,
        Meta(
            min_length=1,
            description="the calibration, counters of starts, signing time: must survive a power cut",
        ),
    ] = "/var/lib/skyfix"
    link: LinkSettings = BASE_LINK  # boxes dial in here, or the router that this station dials
    receiver: ReceiverSection | None = None
    calibration: CalibrationSection = CalibrationSection()
    tracking: TrackingSection = TrackingSection()
    mavlink: MavlinkSection = MavlinkSection()
    output: Annotated[
        dict[Name, dict[str, Any]],
        Meta(
            description="further outputs, each [output.NAME]: a folder of the program, or `module` as Python imports it"
        ),
    ] = {}
    recording: RecordingSection = RecordingSection()
    clock: ClockConfig = ClockConfig()
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
    _refuse(
        config.status.tls and config.link.tls is None,
        path,
        "status.tls is served with the files of [link.tls], and there are none",
        "make them with `base-station certs issue`, or leave status.tls out",
    )
    _refuse(
        None is not config.mavlink.gcs_component == config.mavlink.ecef_component,
        path,
        "mavlink.gcs_component and mavlink.ecef_component are the same",
        "give each its own: receivers count what is lost by the numbers of one component",
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
