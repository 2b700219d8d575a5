"""The camera box's configuration: what the file may hold, and nothing else.

Every key has a type, a range and a sentence, and edge/common/settings.py turns what does not fit into an error that
names them. Durations are in seconds and speeds in pixels per second, so that a setting means the same on a camera of
another frame rate. `deploy/edge.example.toml` shows every key; a test holds that it does.
"""

from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from edge.common.errors import ConfigError, LensError
from edge.common.settings import build, load
from edge.lens import LensModel
from edge.link.settings import BOX_LINK, LinkSettings
from edge.messages import Name, SizePx, TimeNs

__all__ = ["BoxConfig", "CameraConfig", "build", "load", "load_box", "load_lens"]

SHIPPED_MODEL: Final = Path(__file__).parent / "models" / "skyfix.onnx"

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Share = Annotated[float, Meta(ge=0, le=1)]


class Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file. Unknown keys in it are refused."""


class SourceConfig(Section, frozen=True, kw_only=True):
    """Where frames come from."""

    path: Annotated[str, Meta(min_length=1, description="video file, image folder, /dev/videoN or rtsp://...")]
    kind: Literal["auto", "file", "v4l2", "rtsp", "folder"] = "auto"
    t0_unix_ns: Annotated[TimeNs, Meta(description="files: UTC of the first frame")] | None = None
    bound_s: Annotated[NotNegative, Meta(description="files: how far t0_unix_ns may be off")] = 0.0
    realtime: Annotated[bool, Meta(description="files: play at the pace of the stamps, dropping what is late")] = False
    start_at_unix_ns: (
        Annotated[TimeNs, Meta(description="realtime: this box's UTC to play the first frame at")] | None
    ) = None
    loop: Annotated[bool, Meta(description="files: begin again at the end, stamps going on")] = False
    follow: Annotated[bool, Meta(description="folder: wait for new images")] = False
    fps: Annotated[float, Meta(gt=0, le=1000, description="asked of a camera; for sources without times")] | None = None
    size_px: Annotated[SizePx, Meta(description="asked of a V4L2 camera")] | None = None
    pixel_format: Annotated[str, Meta(pattern="^.{4}$", description="V4L2 four-letter code")] | None = None
    delay_s: Annotated[float, Meta(ge=-1, le=1, description="constant taken off every stamp")] = 0.0
    stamp_of: Annotated[
        Literal["middle", "exposure_start", "exposure_end", "frame_end"],
        Meta(description="V4L2: which instant of a frame the driver stamps"),
    ] = "middle"
    timeout_s: Annotated[float, Meta(gt=0, le=60, description="live: no frame for so long is a dead camera")] = 2.0


class LensConfig(Section, frozen=True, kw_only=True):
    """A lens: the numbers `edge-node lens` writes."""

    model: Literal["radtan", "fisheye"]
    intrinsics: Annotated[tuple[float, float, float, float], Meta(description="fx, fy, cx, cy in pixels")]
    distortion: Annotated[tuple[float, ...], Meta(description="OpenCV's order")]
    size_px: SizePx
    rms_px: NotNegative = 0.0
    focal_sigma_px: Positive | None = None
    report: Annotated[dict[str, object], Meta(description="how the lens was measured; not read")] = {}


class DetectorConfig(Section, frozen=True, kw_only=True):
    """What finds objects in a frame."""

    model: Annotated[str, Meta(description="ONNX file; empty for the one shipped")] = ""
    mode: Annotated[
        Literal["auto", "two_stage", "full_frame"],
        Meta(description="auto: full_frame for pictures below 640 x 480 and for others' models, else two_stage"),
    ] = "auto"
    format: Annotated[
        Literal["auto", "skyfix", "yolov8", "end_to_end", "yolox", "detr", "labels_boxes_scores"],
        Meta(description="only where the model's own shapes do not say it"),
    ] = "auto"
    class_names: tuple[str, ...] = ()
    input_size_px: Annotated[SizePx, Meta(description="for models whose input size is free")] | None = None
    score_min: Share = 0.25
    nms_iou: Share = 0.45
    max_detections: Annotated[int, Meta(ge=1, le=1000)] = 100
    tiles: Annotated[bool, Meta(description="full_frame: cut into overlapping tiles of the model's size")] = False
    threads: Annotated[int, Meta(ge=1, le=64, description="per ONNX session")] = 1
    workers: Annotated[int, Meta(ge=1, le=16, description="full_frame: frames worked on side by side")] = 2
    max_crops: Annotated[int, Meta(ge=1, le=64, description="two_stage: crops a frame")] = 8
    scan_period_s: Annotated[NotNegative, Meta(description="two_stage: between full scans; 0 for none")] = 1.0


class GateConfig(Section, frozen=True, kw_only=True):
    """What makes detections a track."""

    profile: Literal["tracks", "paper"] = "tracks"
    score_confirm: (
        Annotated[Share, Meta(description="mean score of a track to be believed; left out: what suits the model")]
        | None
    ) = None
    confirm_hits: Annotated[int, Meta(ge=2, le=100)] = 5
    confirm_window_s: Positive = 0.27
    speed_max_px_s: Annotated[float, Meta(gt=0, description="faster is not followed")] = 900.0
    moved_min_px: Annotated[NotNegative, Meta(description="net movement that shows a track to fly")] = 6.0
    moved_window_s: Positive = 1.0
    coast_max_s: Annotated[NotNegative, Meta(description="gap over which a track keeps its number")] = 2.0
    bridge_max_s: Annotated[NotNegative, Meta(description="gap between sure looks filled with interpolated rows")] = 1.0


class GnssConfig(Section, frozen=True, kw_only=True):
    """The box's RTK receiver."""

    device: Annotated[str, Meta(min_length=1, description="serial device, socket://host:port or a recording")]
    baud: Annotated[int, Meta(ge=0, le=4_000_000, description="0: try the usual ones")] = 115200
    service: Annotated[
        Literal["own-base", "network-rtk", "ppp-rtk"], Meta(description="where the corrections come from")
    ] = "network-rtk"
    baseline_m: Annotated[float, Meta(ge=0, le=1e5, description="to the base station, where there is a real one")] = 0.0
    frame: Annotated[str, Meta(description="the corrections' reference frame, such as ETRS89")] = "WGS84"
    separation_m: (
        Annotated[float, Meta(ge=-120, le=100, description="geoid separation, for a receiver that sends none")] | None
    ) = None
    accept_unknown_age: Annotated[bool, Meta(description="for a receiver that sends no age of corrections")] = False
    lever_arm_m: Annotated[
        tuple[float, float, float], Meta(description="antenna minus camera: east, north, up metres")
    ] = (0.0, 0.0, 0.0)


class ClockConfig(Section, frozen=True, kw_only=True):
    """How the box knows UTC."""

    source: Annotated[
        Literal["auto", "ptp", "assumed"], Meta(description="auto: chrony, else the kernel; ptp: ptp4l")
    ] = "auto"
    limit_s: Annotated[Positive, Meta(description="check fails where UTC may be further off")] = 0.01
    assumed_bound_s: Annotated[NotNegative, Meta(description="assumed: how far this box's UTC may be off")] = 0.01


class SpoolConfig(Section, frozen=True, kw_only=True):
    """Where observations wait for a base that is out of reach: a file for each camera."""

    folder: Annotated[str, Meta(min_length=1)] = "/var/lib/skyfix"
    max_mb: Annotated[int, Meta(ge=1, le=1_000_000, description="a camera; 500 MB is about nine hours at 30 Hz")] = 500


class CameraConfig(Section, frozen=True, kw_only=True):
    """One camera of the box."""

    id: Name
    source: SourceConfig
    lens: Annotated[str | LensConfig, Meta(description="a lens file, or the numbers themselves")]
    readout_s: Annotated[float, Meta(ge=0, le=1, description="first to last row of a rolling shutter")] = 0.0
    exposure_s: Annotated[float, Meta(ge=0, le=1, description="used with source.stamp_of")] = 0.0
    cores: Annotated[tuple[int, ...], Meta(description="CPU cores its process is kept to; empty for any")] = ()
    detector: DetectorConfig | None = None
    gate: GateConfig | None = None


class BoxConfig(Section, frozen=True, kw_only=True):
    """A camera box: its site, its cameras, and what they share."""

    site: Name
    camera: Annotated[tuple[CameraConfig, ...], Meta(min_length=1, description="one [[camera]] each")]
    link: LinkSettings = BOX_LINK
    gnss: GnssConfig | None = None
    clock: ClockConfig = ClockConfig()
    detector: DetectorConfig = DetectorConfig()
    gate: GateConfig = GateConfig()
    spool: (
        Annotated[SpoolConfig, Meta(description="observations kept on disk for a base that was out of reach")] | None
    ) = None
    log_level: Literal["debug", "info", "warning", "error"] = "info"

    def __post_init__(self) -> None:
        names = [camera.id for camera in self.camera]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"camera {twice[0]} is named twice: give each [[camera]] an id of its own")

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
        return LensModel(
            model=numbers.model,
            intrinsics=numbers.intrinsics,
            distortion=numbers.distortion,
            size_px=numbers.size_px,
            rms_px=numbers.rms_px,
            focal_sigma_px=numbers.focal_sigma_px,
        )
    except LensError as error:
        raise ConfigError(error.what, where=where, action=error.action) from error
