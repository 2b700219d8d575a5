"""Sources of frames behind one interface: V4L2, libcamera, GenICam, RTSP, video file, image folder."""

import datetime as dt
import re
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal

import cv2

from edge.capture.address import shown
from edge.capture.creation_time import creation_unix_s
from edge.capture.folder import ImageFolder
from edge.capture.frame import FrameSource, Image, Picture, Remark, StampRule, TimeSource
from edge.capture.genicam import GENICAM_SCHEME, GenicamCamera, aravis
from edge.capture.libcamera import LIBCAMERA_SCHEME, LibcameraCamera, picamera2
from edge.capture.live import RtspStream, open_rtsp
from edge.capture.pacing import Realtime
from edge.capture.v4l2 import V4l2Camera, open_v4l2
from edge.capture.video import VideoFile
from edge.capture.wish import CameraWish
from edge.common.errors import ConfigError
from edge.common.utc import Dated
from edge.config import CameraConfig

__all__ = ["FrameSource", "Image", "Picture", "TimeSource", "is_live", "is_lossless", "kind_of", "open_source"]

# A recording that nobody dated is dated to this instant, so that it can be looked at, with a bound that says so.
UNDATED_T_UNIX_NS: Final = 1_500_000_000 * 10**9
UNDATED_BOUND_S: Final = None

Kind = Literal["file", "v4l2", "rtsp", "folder", "genicam", "libcamera"]

cv2.setNumThreads(1)  # frames are worked on side by side, by threads of our own, and not within one
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_WARNING)  # what it warns of is ours to know


def kind_of(camera: CameraConfig) -> Kind:
    """What kind of source a path names. Raises ConfigError where it could be several."""
    source = camera.source
    if source.kind != "auto":
        return source.kind
    if re.match(r"rtsps?://", source.path):
        return "rtsp"
    if source.path.startswith(GENICAM_SCHEME):
        return "genicam"
    if source.path.startswith(LIBCAMERA_SCHEME):
        return "libcamera"
    if re.match(r"/dev/video\d+$|/dev/v4l/", source.path):
        return "v4l2"
    if "://" in source.path:
        raise ConfigError(
            f"source {shown(source.path)} is of no known kind",
            where=f"camera {camera.id}",
            action="give rtsp://..., libcamera://0, genicam://NAME, a file, a folder or /dev/videoN, or say which"
            ' with source.kind = "rtsp"',
        )
    return "folder" if Path(source.path).is_dir() else "file"


def is_live(camera: CameraConfig) -> bool:
    """Whether the source is a camera, to be opened again when it dies."""
    return kind_of(camera) in ("v4l2", "rtsp", "genicam", "libcamera")


def is_lossless(camera: CameraConfig) -> bool:
    """Whether every frame counts and none is in a hurry: a recording that is not played in real time."""
    return not is_live(camera) and not camera.source.realtime


def open_source(
    camera: CameraConfig, *, colour: bool, stop: threading.Event, date: Callable[[int], Dated]
) -> FrameSource:
    """The camera's source, opened.

    colour: whether BGR is needed. stop: set to end every wait within it. date: UTC of a monotonic stamp.
    Raises SourceError, ConfigError.
    """
    kind = kind_of(camera)
    source = camera.source
    wish = CameraWish(source.size_px, source.pixel_format, source.fps, source.exposure_s, source.gain)
    exposure_s = camera.exposure_s or source.exposure_s or 0.0
    rule = StampRule(source.stamp_of, exposure_s, camera.readout_s or 0.0, source.delay_s)
    if kind == "v4l2":
        capture, remarks = open_v4l2(source.path, wish, source.timeout_s)
        return V4l2Camera(capture, source.path, colour=colour, rule=rule, fps=source.fps, remarks=remarks, date=date)
    if kind == "genicam":
        name = source.path.removeprefix(GENICAM_SCHEME)
        return GenicamCamera(aravis(), name, wish=wish, colour=colour, timeout_s=source.timeout_s, rule=rule, date=date)
    if kind == "libcamera":
        name, delay_s = source.path.removeprefix(LIBCAMERA_SCHEME), source.delay_s
        return LibcameraCamera(
            picamera2(), name, wish=wish, colour=colour, timeout_s=source.timeout_s, delay_s=delay_s, date=date
        )
    if kind == "rtsp":
        stream = open_rtsp(source.path, source.timeout_s)
        return RtspStream(stream, source.path, colour=colour, delay_s=source.delay_s, date=date)
    return _open_recording(camera, kind, colour, stop)


def _undated(path: str) -> Remark:
    """That nobody says when a recording was made, and what its file says of that."""
    created_s = creation_unix_s(path)
    offered = "set source.t0_unix_ns to UTC of its first frame"
    if created_s is not None:
        date = dt.datetime.fromtimestamp(created_s, dt.UTC).strftime("%Y-%m-%d %H:%M:%S")
        offered = f"if its creation time, {date} UTC, is right, set source.t0_unix_ns = {created_s}000000000"
    return Remark("nobody says when it was recorded: it is dated to 2017-07-14, without a bound", offered)


def _open_recording(camera: CameraConfig, kind: Kind, colour: bool, stop: threading.Event) -> FrameSource:
    source = camera.source
    dated = source.t0_unix_ns is not None
    t0_unix_ns = (source.t0_unix_ns if dated else UNDATED_T_UNIX_NS) - round(source.delay_s * 1e9)  # type: ignore[operator]
    bound_s = source.bound_s if dated else UNDATED_BOUND_S
    if kind == "folder":
        return ImageFolder(
            source.path,
            t0_unix_ns=t0_unix_ns,
            bound_s=source.bound_s,
            fps=source.fps,
            follow=source.follow,
            loop=source.loop,
            colour=colour,
            stop=stop,
        )
    video = VideoFile(
        source.path,
        t0_unix_ns=t0_unix_ns,
        bound_s=bound_s,
        colour=colour,
        fps=source.fps,
        loop=source.loop,
        remarks=() if dated else (_undated(source.path),),
    )
    return Realtime(video, stop, source.start_at_unix_ns) if source.realtime else video
