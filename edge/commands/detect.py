"""`edge-node detect`: what a model sees in a recording, without a network, a base or a lens.

For whoever wants to know whether the shipped model sees their drone, or whether their own does, before a tripod is put
up. It is the box's own camera worker that looks, so what is found here is what a box would publish; only that nothing
is published: the rows go into a track folder, as `base-station solve` reads it, with a sheet of pictures beside it.
"""

import argparse
import csv
import io
import re
import threading
from pathlib import Path
from typing import Final

import msgspec

from edge.camera import CameraWorker
from edge.capture import is_live, open_source
from edge.capture.address import shown
from edge.capture.folder import ImageFolder
from edge.capture.frame import FrameSource
from edge.capture.video import VideoFile
from edge.common.atomic import write_atomically
from edge.common.errors import ConfigError, SourceError
from edge.common.progress import Progress
from edge.common.utc import UtcMapping
from edge.config import BoxConfig, CameraConfig, LensConfig, SourceConfig, build, load
from edge.messages import Tracks
from edge.pictures.sheet import Sheet

LOOKED_EVERY_S: Final = 0.2  # how often the progress is looked at
TYPED: Final = "what was typed"
OPTION_OF: Final = {"source.t0_unix_ns": "--t0", "source.fps": "--fps"}
COLUMNS: Final = ("t_unix_ns", "u_px", "v_px", "track", "width_px", "height_px", "score", "status")


class Seeing:
    """The rows and the pictures of a recording, as they come."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, float, float, int, float, float, float, str]] = []
        self.sheet = Sheet()
        self.worker: CameraWorker | None = None

    def add(self, message: Tracks) -> None:
        """One more message of the worker, in its own thread."""
        self.rows += [
            (message.t_unix_ns, one.u_px, one.v_px, one.track, one.width_px, one.height_px, one.score, one.status)
            for one in message.detections
        ]
        if self.worker is not None and self.worker.pipeline.latest is not None:
            self.sheet.add(message, self.worker.pipeline.latest[0])

    def table(self) -> bytes:
        """The rows as CSV, in order of time."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(sorted(self.rows))
        return text.getvalue().encode()


def detect(arguments: argparse.Namespace) -> str:
    """Look through a recording and write what is seen; what was done. Raises ConfigError, SourceError, ModelError."""
    box, config_file = _box(arguments)
    camera = box.camera[0]
    found = Seeing()
    worker = CameraWorker(
        box, camera, config_file, epoch=0, clock_bound_s=lambda: 0.0, date=UtcMapping().date, publish=found.add
    )
    found.worker, found.sheet = worker, Sheet(worker.mask)
    total = _frames(camera)
    worker.start()
    try:
        with Progress(camera.id, total) as progress:
            while not worker.join(LOOKED_EVERY_S):
                progress.at(worker.reader.state.frames)
    finally:
        worker.close()
    said = _write(found, worker, arguments.output, camera.id)
    if worker.error is not None:
        raise worker.error
    return said


def _write(found: Seeing, worker: CameraWorker, folder: Path, name: str) -> str:
    frames = worker.reader.state.frames
    did = f"{frames} frames, {found.sheet.tracks} tracks, {len(found.rows)} rows"
    table, sheet = folder / "tracks" / f"{name}.csv", folder / f"{name}.jpg"
    try:
        table.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(table, found.table())
        write_atomically(sheet, found.sheet.draw(f"{name}: {did}"))
    except OSError as error:
        raise SourceError(f"cannot be written ({error})", where=str(folder), action="name another folder") from error
    remarks = [f"{remark.what}; {_here(remark.action)}" for remark in worker.reader.state.remarks]
    return "\n".join([*remarks, did, f"written to {table} and {sheet}"])


def _here(action: str) -> str:
    """What to do, by this command's options where a box would have keys."""
    for key, option in OPTION_OF.items():
        action = action.replace(f"{key} =", option).replace(key, option)
    return action


def _box(arguments: argparse.Namespace) -> tuple[BoxConfig, Path]:
    """The box that would look at this recording: of a configuration, or of nothing but the recording."""
    given = {"path": arguments.source, "fps": arguments.fps, "t0_unix_ns": arguments.t0}
    source = build({key: value for key, value in given.items() if value is not None}, SourceConfig, where=TYPED)
    if arguments.config is not None:
        box = load(arguments.config, BoxConfig)
        chosen = [one for one in box.camera if arguments.camera in (None, one.id)]
        if not chosen:
            names = ", ".join(one.id for one in box.camera)
            raise ConfigError(
                f"has no camera {arguments.camera}", where=str(arguments.config), action=f"choose one of {names}"
            )
        camera = msgspec.structs.replace(chosen[0], source=source)
    else:
        name = arguments.camera or re.sub(r"[^A-Za-z0-9_-]", "-", Path(arguments.source).resolve().stem)[:64]
        tree = {"id": name, "source": {"path": arguments.source}, "lens": ""}
        camera = msgspec.structs.replace(build(tree, CameraConfig, where=TYPED), source=source)
        box = BoxConfig(site="detect", camera=(camera,))
    if is_live(camera):
        action = "give a video file or a folder of pictures; what a camera sees, `edge-node run --preview` shows"
        raise ConfigError("is a camera, not a recording", where=shown(arguments.source), action=action)
    detector = box.detector_of(camera)
    if arguments.model is not None:
        detector = msgspec.structs.replace(detector, model=str(arguments.model))
    lens = camera.lens if arguments.config is not None else pinhole(first_size_px(camera))
    mask = camera.mask if arguments.mask is None else str(Path(arguments.mask).resolve())
    camera = msgspec.structs.replace(camera, lens=lens, mask=mask, detector=detector)
    return msgspec.structs.replace(box, camera=(camera,)), arguments.config or Path.cwd() / "edge.toml"


def first_size_px(camera: CameraConfig) -> tuple[int, int]:
    """Width and height of a recording's first picture. Raises SourceError."""
    source = _open(camera)
    try:
        frame = source.read()
    finally:
        source.close()
    if frame is None:
        raise SourceError("holds no frame", where=camera.source.path, action="play it to check it")
    return frame.size_px


def _frames(camera: CameraConfig) -> int:
    """How many frames a recording says it has; 0 where it does not."""
    source = _open(camera)
    source.close()
    return source.frames_said if isinstance(source, VideoFile | ImageFolder) else 0


def _open(camera: CameraConfig) -> FrameSource:
    return open_source(camera, colour=False, stop=threading.Event(), date=UtcMapping().date)


def pinhole(size_px: tuple[int, int]) -> LensConfig:
    """A lens for pictures of a size that has a ray for every pixel: rays are not written, and nothing else asks it."""
    width, height = size_px
    centre = ((width - 1) / 2, (height - 1) / 2)
    return LensConfig(
        model="radtan",
        intrinsics=(float(width), float(width), *centre),
        distortion=(0.0, 0.0, 0.0, 0.0),
        size_px=size_px,
    )
