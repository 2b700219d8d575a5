"""The camera box's configuration: what the file may hold, and nothing else.

Every key has a type, a range and a sentence, and edge/common/settings.py turns what does not fit into an error that
names them. Durations are in seconds and speeds in pixels per second, so that a setting means the same on a camera of
another frame rate. `deploy/edge.example.toml` shows every key; a test holds that it does.
"""

from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta

from edge.clock.settings import ClockBound, ClockConfig
from edge.common.errors import ConfigError, LensError
from edge.common.settings import build, load
from edge.detector.formats import AUTO, FormatName, check_format
from edge.gnss.settings import ReceiverSettings
from edge.lens import LensModel, LensName, check_lens_name
from edge.link.security import Bearer
from edge.link.settings import BOX_LINK, LinkSettings
from edge.messages import Name, Pixel, SizePx, TimeNs

__all__ = ["BoxConfig", "CameraConfig", "build", "load", "load_box", "load_lens"]

SHIPPED_MODEL: Final = Path(__file__).parent / "models" / "skyfix.onnx"

Seconds = Annotated[float, Meta(gt=0, le=3600)]
SecondsOrNone = Annotated[float, Meta(ge=0, le=3600)]
Share = Annotated[float, Meta(ge=0, le=1)]
Coefficient = Annotated[float, Meta(ge=-1e6, le=1e6)]  # whether they bend like a lens, LensModel says
LeverArm = Annotated[float, Meta(ge=-100, le=100)]
Core = Annotated[int, Meta(ge=0, le=1023)]


class Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file. Unknown keys in it are refused."""


class SourceConfig(Section, frozen=True, kw_only=True):
    """Where frames come from."""

    path: Annotated[
        str,
        Meta(
            min_length=1,
            description="video file, image folder, /dev/videoN, rtsp://..., libcamera://0 or genicam://NAME",
        ),
    ]
    kind: Annotated[
        Literal["auto", "file", "v4l2", "rtsp", "folder", "genicam", "libcamera"],
        Meta(description="auto: what the path looks like"),
    ] = "auto"
    t0_unix_ns: Annotated[TimeNs | None, Meta(description="files: UTC of the first frame")] = None
    bound_s: Annotated[
        ClockBound | None,
        Meta(description="files: how far t0_unix_ns, or times in names, may be off; left out: not known"),
    ] = None
    realtime: Annotated[bool, Meta(description="files: play at the pace of the stamps, dropping what is late")] = False
    start_at_unix_ns: Annotated[
        TimeNs | None, Meta(description="realtime: this box's UTC to play the first frame at")
    ] = None
    loop: Annotated[bool, Meta(description="files, folders: begin again at the end, stamps going on")] = False
    follow: Annotated[bool, Meta(description="folder: wait for new images")] = False
    fps: Annotated[
        Annotated[float, Meta(gt=0, le=1000)] | None,
        Meta(
            description="frames a second: asked of a camera; the rate of files and folders without times of their own"
        ),
    ] = None
    size_px: Annotated[SizePx | None, Meta(description="width and height asked of a V4L2 camera")] = None
    pixel_format: Annotated[
        Annotated[str, Meta(pattern="^.{4}$")] | None, Meta(description="four-letter code asked of a V4L2 camera")
    ] = None
    exposure_s: Annotated[
        Annotated[float, Meta(gt=0, le=1)] | None,
        Meta(description="asked of a camera, which is set to manual exposure for it"),
    ] = None
    gain: Annotated[
        Annotated[float, Meta(ge=0, le=1e6)] | None, Meta(description="asked of a camera, in its driver's units")
    ] = None
    delay_s: Annotated[float, Meta(ge=-1, le=1, description="constant taken off every stamp")] = 0.0
    stamp_of: Annotated[
        Literal["middle", "exposure_start", "exposure_end", "frame_end"],
        Meta(description="V4L2: which instant of a frame the driver stamps"),
    ] = "middle"
    timeout_s: Annotated[float, Meta(gt=0, le=60, description="live: no frame for so long is a dead camera")] = 2.0


class LensConfig(Section, frozen=True, kw_only=True):
    """A lens: the numbers `edge-node lens` writes."""

    model: Annotated[LensName, Meta(description="OpenCV's pinhole or fisheye model")]
    intrinsics: Annotated[tuple[Pixel, Pixel, Pixel, Pixel], Meta(description="fx, fy, cx, cy in pixels")]
    distortion: Annotated[tuple[Coefficient, ...], Meta(description="coefficients in OpenCV's order")]
    size_px: Annotated[SizePx, Meta(description="width and height of the pictures it was measured on")]
    rms_px: Annotated[float, Meta(ge=0, le=1e5, description="what the corners of the boards missed it by")] = 0.0
    focal_sigma_px: Annotated[
        Annotated[float, Meta(gt=0, le=1e5)] | None,
        Meta(description="one sigma of fx and fy; left out: a hundredth of them"),
    ] = None
    report: Annotated[dict[str, Any], Meta(description="how the lens was measured; not read")] = {}

    def __post_init__(self) -> None:
        check_lens_name("model", self.model)


class DetectorConfig(Section, frozen=True, kw_only=True):
    """What finds objects in a frame."""

    model: Annotated[str, Meta(description="ONNX file; empty for the one shipped")] = ""
    mode: Annotated[
        Literal["auto", "two_stage", "full_frame"],
        Meta(description="auto: full_frame for pictures below 640 x 480 and for others' models, else two_stage"),
    ] = "auto"
    format: Annotated[
        FormatName,
        Meta(description="only where the model's own shapes do not say it"),
    ] = AUTO
    class_names: Annotated[
        tuple[str, ...], Meta(description="in the model's order, where the model does not carry them")
    ] = ()
    input_size_px: Annotated[
        SizePx | None, Meta(description="width and height, for models whose input size is free")
    ] = None
    score_min: Annotated[Share, Meta(description="a detection below it is dropped")] = 0.25
    nms_iou: Annotated[Share, Meta(description="overlap (IoU) from which two boxes are one object")] = 0.45
    max_detections: Annotated[int, Meta(ge=1, le=1000, description="kept of a frame, the surest first")] = 100
    tiles: Annotated[bool, Meta(description="full_frame: cut into overlapping tiles of the model's size")] = False
    threads: Annotated[int, Meta(ge=1, le=64, description="per ONNX session")] = 1
    providers: Annotated[
        tuple[str, ...], Meta(description="ONNX Runtime's execution providers, first choice first; empty for the CPU")
    ] = ()
    workers: Annotated[int, Meta(ge=1, le=16, description="full_frame: frames worked on side by side")] = 2
    max_crops: Annotated[
        int,
        Meta(
            ge=1,
            le=64,
            description="two_stage: crops a frame; tracks may take four times these, what waits as many again",
        ),
    ] = 8
    scan_period_s: Annotated[SecondsOrNone, Meta(description="two_stage: between full scans; 0 for none")] = 1.0

    def __post_init__(self) -> None:
        check_format("format", self.format)


class GateConfig(Section, frozen=True, kw_only=True):
    """What makes detections a track."""

    profile: Annotated[Literal["tracks", "paper"], Meta(description="paper: the published rules 1 and 2")] = "tracks"
    score_confirm: Annotated[
        Share | None, Meta(description="mean score of a track to be confirmed; left out: what suits the model")
    ] = None
    confirm_hits: Annotated[int, Meta(ge=2, le=100, description="detections that confirm a track")] = 5
    confirm_window_s: Annotated[Seconds, Meta(description="within which the confirm_hits must fall")] = 0.27
    speed_max_px_s: Annotated[float, Meta(gt=0, le=1e6, description="faster is not followed")] = 900.0
    moved_min_px: Annotated[float, Meta(ge=0, le=1e5, description="net movement that shows a track to fly")] = 6.0
    moved_window_s: Annotated[Seconds, Meta(description="within which moved_min_px must be covered")] = 1.0
    coast_max_s: Annotated[SecondsOrNone, Meta(description="gap over which a track keeps its number")] = 2.0
    bridge_max_s: Annotated[SecondsOrNone, Meta(description="gap between sure looks filled with interpolated rows")] = (
        1.0
    )


class GnssConfig(ReceiverSettings, frozen=True, kw_only=True):
    """The box's RTK receiver."""

    frame: Annotated[str, Meta(description="the corrections' reference frame, such as ETRS89")] = "WGS84"
    lever_arm_m: Annotated[
        tuple[LeverArm, LeverArm, LeverArm] | None,
        Meta(description="antenna's phase centre minus lens: east, north, up metres; left out: not known"),
    ] = None


class SpoolConfig(Section, frozen=True, kw_only=True):
    """Where observations wait for a base that is out of reach: a file for each camera."""

    folder: Annotated[str, Meta(min_length=1, description="on a disk that survives a power cut")] = "/var/lib/skyfix"
    max_mb: Annotated[
        int, Meta(ge=1, le=1_000_000, description="megabytes a camera; 500 are about nine hours at 30 Hz")
    ] = 500


Readout = Annotated[float, Meta(ge=0, le=1)]


class CameraConfig(Section, frozen=True, kw_only=True):
    """One camera of the box."""

    id: Annotated[Name, Meta(description="unique on the site, and the same in the base's list")]
    source: SourceConfig
    lens: Annotated[str | LensConfig, Meta(description="a lens file, or the numbers themselves")]
    mask: Annotated[str, Meta(description="a file of regions that the detector leaves out; empty for none")] = ""
    readout_s: Annotated[
        Readout | None,
        Meta(description="first to last row of a rolling shutter, 0 for a global one; left out: not known"),
    ] = None
    exposure_s: Annotated[float, Meta(ge=0, le=1, description="known exposure, used with source.stamp_of")] = 0.0
    cores: Annotated[tuple[Core, ...], Meta(description="CPU cores its threads are kept to; empty for any")] = ()
    detector: DetectorConfig | None = None
    gate: GateConfig | None = None

    def __post_init__(self) -> None:
        if self.source.stamp_of == "frame_end" and self.readout_s is None:
            raise ValueError('source.stamp_of = "frame_end" is told from readout_s: give it, 0 for a global shutter')


class BoxConfig(Section, frozen=True, kw_only=True):
    """A camera box: its site, its cameras, and what they share."""

    site: Annotated[Name, Meta(description="the same on every box and on the base")]
    camera: Annotated[tuple[CameraConfig, ...], Meta(min_length=1, description="one [[camera]] each")]
    link: LinkSettings = BOX_LINK
    gnss: GnssConfig | None = None
    clock: ClockConfig = ClockConfig()
    detector: DetectorConfig = DetectorConfig()
    gate: GateConfig = GateConfig()
    spool: SpoolConfig | None = None
    log_level: Annotated[Literal["debug", "info", "warning", "error"], Meta(description="the least that is logged")] = (
        "info"
    )

    def __post_init__(self) -> None:
        names = [camera.id for camera in self.camera]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"camera {twice[0]} is named twice: give each [[camera]] an id of its own")

    @property
    def bearer(self) -> Bearer:
        """Whom the box's certificate has to be for."""
        return Bearer(self.site, "camera", tuple(camera.id for camera in self.camera))

    def detector_of(self, camera: CameraConfig) -> DetectorConfig:
        """The camera's own detector settings, or else the box's."""
        return camera.detector or self.detector

    def gate_of(self, camera: CameraConfig) -> GateConfig:
        """The camera's own gating settings, or else the box's."""
        return camera.gate or self.gate


def load_box(path: Path | str) -> BoxConfig:
    """The box's configuration, its lens files checked. Raises ConfigError."""
    config = load(path, BoxConfig)
    for camera in config.camera:
        load_lens(camera, Path(path))
    return config


def load_lens(camera: CameraConfig, config_file: Path) -> LensModel:
    """A camera's lens; a relative lens file is looked for beside the configuration. Raises ConfigError."""
    where = f"{config_file}: camera {camera.id}: lens"
    numbers = camera.lens
    if isinstance(numbers, str):
        file = config_file.parent / numbers
        if not file.exists():
            measure = f"measure the lens: edge-node lens PHOTOS... --board 9x6 -o {file}"
            raise ConfigError("no such lens file", where=where, action=f"{measure}, or give a [camera.lens] table")
        where, numbers = str(file), load(file, LensConfig)
    try:
        return LensModel.of(numbers)
    except LensError as error:
        raise ConfigError(error.what, where=where, action=error.action) from error
