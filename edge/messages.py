"""The wire contract: every struct that crosses Zenoh, and its key.

Two programs of different versions, or a program of somebody else's, meet on these bytes. So: unknown fields are
ignored, missing optional ones defaulted, a word that a later version added to a list of words is read as the most
cautious of those known, and everything else that is not exactly what the contract says is refused here, at the border,
and never inside. JSON has no NaN, but a decoder may still hand on 1e308 or a time in 1970; the
ranges are therefore checked as well as the types. Who wrote a message is taken from its key, which access control
checks, never from its payload.
"""

import inspect
from typing import Annotated, Final, Literal, TypeVar

import msgspec
from msgspec import Meta

from edge.common.errors import MessageError
from edge.common.health import HealthLevel
from edge.common.newer_words import newer_word, with_known_words
from edge.lens import LensModel, LensName, check_lens_name

VERSION: Final = 1
ENCODING: Final = "application/json"

# Four detectors' worth of clutter; a frame that claims more is broken or hostile.
MAX_DETECTIONS: Final = 1000
# A box asked for more at once would be kept from its live work; ten seconds of a 30 Hz camera.
MAX_BACKLOG_ROWS: Final = 300
# 2001-09-09 to 2096: outside it a clock was never set.
MIN_T_UNIX_NS: Final = 1_000_000_000 * 10**9
MAX_T_UNIX_NS: Final = 4_000_000_000 * 10**9

# A box that was never told the time still says how it is, and above all that.
AnyTimeNs = Annotated[int, Meta(ge=0, le=MAX_T_UNIX_NS)]
TimeNs = Annotated[int, Meta(ge=MIN_T_UNIX_NS, le=MAX_T_UNIX_NS)]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
# A pixel may lie a little outside the image (an interpolated row), never far.
MAX_PIXEL: Final = 1e5
MAX_RAY: Final = 1e3  # beyond, a ray is sideways
Pixel = Annotated[float, Meta(ge=-MAX_PIXEL, le=MAX_PIXEL)]
Ray = Annotated[float, Meta(ge=-MAX_RAY, le=MAX_RAY)]
Metre = Annotated[float, Meta(ge=-1e8, le=1e8)]
Seconds = Annotated[float, Meta(ge=0, le=1e6)]
Probability = Annotated[float, Meta(ge=0, le=1)]
Sigma = Annotated[float, Meta(ge=0, le=1e6)]
Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Height = Annotated[float, Meta(ge=-1000, le=10000)]
Position = tuple[Latitude, Longitude, Height]  # degrees, ellipsoidal metres
SizePx = tuple[Annotated[int, Meta(ge=1, le=65535)], Annotated[int, Meta(ge=1, le=65535)]]


class Detection(msgspec.Struct, frozen=True, kw_only=True):
    """One object in one frame: raw pixel centre, its undistorted ray (z = 1), box size, and how it was come by."""

    track: Annotated[int, Meta(ge=0, le=2**53)]
    u_px: Pixel
    v_px: Pixel
    ray_x: Ray
    ray_y: Ray
    width_px: Annotated[float, Meta(ge=0, le=1e5)]
    height_px: Annotated[float, Meta(ge=0, le=1e5)]
    score: Probability
    sigma_px: Annotated[float, Meta(gt=0, le=1e4)] | None = None
    classes: dict[str, Probability] | None = None
    # An unknown status is no measurement.
    status: Annotated[Literal["confirmed", "interpolated"], newer_word("interpolated")]


class Tracks(msgspec.Struct, frozen=True, kw_only=True):
    """What one camera saw in one frame. An empty `detections` means "sees nothing"; silence means "is gone".

    readout_s: first to last row of a rolling shutter; 0: a global shutter; null: the box does not know.
    late: rows that were found out later, about a frame that is past; out of order on purpose.
    """

    t_unix_ns: TimeNs
    seq: Annotated[int, Meta(ge=0, le=2**53)]
    epoch: Annotated[int, Meta(ge=0, le=2**53)]
    clock_bound_s: Seconds | None
    size_px: SizePx
    readout_s: Annotated[float, Meta(ge=0, le=1)] | None
    detections: Annotated[list[Detection], Meta(max_length=MAX_DETECTIONS)]
    late: bool = False


class Lens(msgspec.Struct, frozen=True, kw_only=True):
    """A camera's lens as its box knows it; `distortion` in OpenCV's order."""

    model: LensName
    intrinsics: tuple[float, float, float, float]
    distortion: Annotated[list[float], Meta(max_length=8)]
    rms_px: Sigma
    size_px: SizePx
    focal_sigma_px: Annotated[float, Meta(gt=0, le=1e5)] | None = None

    def __post_init__(self) -> None:
        check_lens_name("model", self.model)

    @classmethod
    def of(cls, lens: LensModel) -> "Lens":
        """A lens as it goes over the wire; LensModel.of is the way back."""
        return cls(
            model=lens.model,
            intrinsics=lens.intrinsics,
            distortion=list(lens.distortion),
            rms_px=lens.rms_px,
            size_px=lens.size_px,
            focal_sigma_px=lens.focal_sigma_px,
        )


FixStanding = Literal["held", "unconfirmed", "doubted"]
WireFixStanding = Annotated[FixStanding, newer_word("doubted")]


class Fix(msgspec.Struct, frozen=True, kw_only=True):
    """An averaged position of a camera box: degrees, ellipsoidal metres, one sigma east, north, up.

    standing: whether the box stands by it. Not any more, for the reason in `why`, where its receiver confirms it no
    longer (`unconfirmed`) or speaks against it (`doubted`); the numbers are then the last it stood by, `quality` is 0.
    of: the point it is the position of. A box that knows its antenna's offset (gnss.lever_arm_m) sends the lens; one
    that does not, or is too old to say, the antenna.
    """

    t_unix_ns: TimeNs
    lat_deg: Latitude
    lon_deg: Longitude
    height_m: Height
    quality: Annotated[int, Meta(ge=0, le=8)]
    sigma_m: tuple[Sigma, Sigma, Sigma]
    frame: str
    samples: Annotated[int, Meta(ge=1)]
    of: Literal["lens", "antenna"] = "antenna"
    standing: WireFixStanding = "held"
    why: str = ""


WireLevel = Annotated[HealthLevel, newer_word("warn")]


class HealthItem(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that is or is not well: since when, why, and what to do."""

    name: str
    level: WireLevel
    since_unix_ns: AnyTimeNs
    reason: str
    action: str = ""


class Health(msgspec.Struct, frozen=True, kw_only=True):
    """How a program is; `level` is the worst of `items`. `counters` only ever grow within an epoch.

    version: of the program; "" from one that is too old to say.
    """

    t_unix_ns: AnyTimeNs
    epoch: int
    level: WireLevel
    items: list[HealthItem]
    counters: dict[str, float]
    version: Annotated[str, Meta(max_length=64)] = ""


TargetState = Literal["tentative", "confirmed", "coasting", "lost"]
WireTargetState = Annotated[TargetState, newer_word("tentative")]


class Target(msgspec.Struct, frozen=True, kw_only=True):
    """One object's state in ECEF; `covariance` is the row-major upper triangle of the 6 x 6 of position, velocity.

    verified: three cameras or more agree about it, and what each claims of its own place and lens others check. Where
    two do, or the site has three cameras, a single one may put it elsewhere.
    """

    track: Annotated[int, Meta(ge=0, le=2**32 - 1)]
    state: WireTargetState
    ecef_m: tuple[Metre, Metre, Metre]
    velocity_m_s: tuple[float, float, float]
    covariance: Annotated[list[float], Meta(min_length=21, max_length=21)]
    cameras: list[str]
    age_s: Seconds
    verified: bool = False


class Targets(msgspec.Struct, frozen=True, kw_only=True):
    """All targets of a station at one instant."""

    t_unix_ns: TimeNs
    targets: list[Target]


class NetworkCamera(msgspec.Struct, frozen=True, kw_only=True):
    """One calibrated camera: ENU-to-camera rotation (row-major), optical centre, clock, lens as refined."""

    id: Name
    R_cam_enu: tuple[float, float, float, float, float, float, float, float, float]
    centre_enu: tuple[Metre, Metre, Metre]
    sigma_centre_m: tuple[Sigma, Sigma, Sigma]
    sigma_attitude_rad: tuple[Sigma, Sigma, Sigma]
    clock_offset_s: float
    clock_rate: float
    readout_s: float
    lens: Lens


StationState = Literal["collecting", "calibrated", "suspect", "blind"]
WireStationState = Annotated[StationState, newer_word("collecting")]


class NetworkMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The station's calibration state, why it is that, what to do next, and the network in force if there is one."""

    t_unix_ns: TimeNs
    state: WireStationState
    reason: str
    action: str
    origin: tuple[float, float, float] | None = None
    cameras: list[NetworkCamera] = []
    rms_px: float | None = None


class SurveyedCamera(msgspec.Struct, frozen=True, kw_only=True):
    """A camera that the configuration names, and the position of its optical centre if the survey gives one.

    position: latitude deg, longitude deg, ellipsoidal m; position_sigma_m: one sigma east, north, up.
    """

    id: Name
    position: Position | None = None
    position_sigma_m: tuple[Sigma, Sigma, Sigma] | None = None


class SurveyMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The configured cameras and survey in force: what a recording needs to be solved by itself.

    origin: of the local frame, if the configuration gives one. At the head of every file of a recording.
    """

    t_unix_ns: TimeNs
    site: Name
    origin: Position | None = None
    cameras: list[SurveyedCamera]


class SpooledEpoch(msgspec.Struct, frozen=True, kw_only=True):
    """What a box still has on disk of one run of its program: sequence numbers first to last, `rows` of them."""

    epoch: Annotated[int, Meta(ge=0, le=2**53)]
    first_seq: Annotated[int, Meta(ge=0, le=2**53)]
    last_seq: Annotated[int, Meta(ge=0, le=2**53)]
    rows: Annotated[int, Meta(ge=0, le=2**53)]


class Inventory(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to `backlog` without parameters: what the box could still deliver."""

    epochs: Annotated[list[SpooledEpoch], Meta(max_length=10_000)]


class Backlog(msgspec.Struct, frozen=True, kw_only=True):
    """One answer to `backlog?epoch=E;first=A;last=Z`: every Tracks kept of these sequence numbers, as it was sent.

    One question gets several answers; what lies between first_seq and last_seq and is not in `tracks` is gone for good.
    """

    epoch: Annotated[int, Meta(ge=0, le=2**53)]
    first_seq: Annotated[int, Meta(ge=0, le=2**53)]
    last_seq: Annotated[int, Meta(ge=0, le=2**53)]
    tracks: Annotated[
        list[Annotated[msgspec.Raw, Meta(extra_json_schema={"$ref": "Tracks.json"})]],
        Meta(max_length=MAX_BACKLOG_ROWS),
    ]


MESSAGES: Final[dict[str, type[msgspec.Struct]]] = {
    "cam/tracks": Tracks,
    "cam/lens": Lens,
    "cam/fix": Fix,
    "cam/health": Health,
    "station/network": NetworkMessage,
    "station/targets": Targets,
    "station/health": Health,
    "station/survey": SurveyMessage,
}

Message = TypeVar("Message", bound=msgspec.Struct)


def site_key(site: str, rest: str) -> str:
    """The Zenoh key expression of everything at a site that matches `rest`, such as `**`."""
    return f"skyfix/{VERSION}/{site}/{rest}"


def camera_key(site: str, camera: str, topic: str = "") -> str:
    """The Zenoh key of a camera's topic; without a topic, that of its liveliness token. `camera` may be `*`."""
    return "/".join(part for part in (site_key(site, f"cam/{camera}"), topic) if part)


def station_key(site: str, topic: str = "") -> str:
    """The Zenoh key of a station's topic; without a topic, that of its liveliness token."""
    return "/".join(part for part in (site_key(site, "station"), topic) if part)


def camera_of_key(key: str) -> str | None:
    """The camera a key belongs to, or None if it is not a camera's key. The only way to know a message's author."""
    parts = key.split("/")
    return parts[4] if len(parts) >= 5 and parts[0] == "skyfix" and parts[3] == "cam" else None


def json_schema(kind: type[msgspec.Struct]) -> dict[str, object]:
    """The JSON Schema (2020-12) of a message, complete in itself: what recordings and deploy/schema carry."""
    schema = msgspec.json.schema(kind)
    root = schema["$defs"].pop(kind.__name__)  # Foxglove wants the object itself at the root, not a reference to it
    root["description"] = inspect.cleandoc(root["description"])
    if schema["$defs"]:
        root["$defs"] = schema["$defs"]
    return dict(root)


def encode(message: msgspec.Struct) -> bytes:
    """JSON bytes (UTF-8) of a message."""
    return msgspec.json.encode(message)


def decode(payload: bytes, kind: type[Message], *, where: str) -> Message:
    """A message from its bytes. Raises MessageError, naming `where`, for anything the contract does not allow."""
    try:
        try:
            return msgspec.json.decode(payload, type=kind)
        except msgspec.ValidationError:
            return msgspec.convert(with_known_words(msgspec.json.decode(payload), kind), kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(
            f"not a {kind.__name__} message ({error})",
            where=where,
            action="check that both ends run the same major version; the message is dropped",
        ) from error
