"""Whether everything a camera box depends on is there: one finding each, with what to do.

A box is set up by somebody in a hurry who will leave it alone for hours. So each thing is tried as it will be used: the
camera gives a frame, the model judges it, the receiver's device opens, the base answers.
"""

import datetime as dt
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from edge.audit import check_files, check_ports, check_program, open_ports, time_sources
from edge.capture import is_lossless, open_source
from edge.capture.address import shown
from edge.capture.frame import FrameSource
from edge.clock.monitor import ClockMonitor
from edge.clock.state import check_clock
from edge.common.errors import ConfigError, SkyfixError
from edge.common.health import Check, HealthLevel
from edge.config import BoxConfig, CameraConfig, DetectorConfig, load_lens
from edge.detector.mask_file import load_mask
from edge.detector.opening import open_detector, where_it_runs
from edge.gnss.receiver import Receiver, check_antenna
from edge.gnss.trial import Telling, silent, try_receiver
from edge.link.counterpart import Counterpart
from edge.link.link import Link
from edge.link.ports import place
from edge.link.security import check_security, files_of
from edge.messages import station_key
from edge.pipeline import CameraFacts, Pipeline, total_bound_s
from edge.temperature import check_temperature

TRIED_FRAMES: Final = 10
STREAM_SETTLES_S: Final = 6.0  # a stream's times are settled within, as far as they will be
LINK_S: Final = 2.0  # opening and hearing of a station takes well under a second on any link that is fit for use


def resolved(config: BoxConfig) -> str:
    """The configuration as it will be used, defaults filled in, passwords left out."""
    cameras = tuple(_without_password(camera) for camera in config.camera)
    shown_config = msgspec.structs.replace(config, camera=cameras)
    return msgspec.json.format(msgspec.json.encode(shown_config), indent=2).decode()


def _without_password(camera: CameraConfig) -> CameraConfig:
    source = msgspec.structs.replace(camera.source, path=shown(camera.source.path))
    return msgspec.structs.replace(camera, source=source)


def check_box(config: BoxConfig, config_file: Path, progress: Telling = silent) -> Iterator[Check]:
    """One finding for each thing the box depends on. progress: told what is waited for."""
    yield Check("configuration", "ok", f"{config_file}: {len(config.camera)} cameras at site {config.site}")
    clock = ClockMonitor(config.clock)
    yield check_clock(clock.state(), config.clock.limit_s)
    yield from check_temperature()
    for camera in config.camera:
        yield from check_camera(config, camera, config_file, clock)
    if config.gnss:
        yield check_receiver(Receiver(config.gnss), progress)
        yield check_antenna(config.gnss)
    if config.spool:
        yield check_spool_folder(Path(config.spool.folder))
    yield check_security(config.link, dt.datetime.now(dt.UTC), config.bearer)
    yield from _audit(config, config_file)
    yield check_link(config)


def _audit(config: BoxConfig, config_file: Path) -> Iterator[Check]:
    """Whether the machine is as closed as the configuration says."""
    passwords = any(shown(camera.source.path) != camera.source.path for camera in config.camera)
    spools = [] if config.spool is None else sorted(Path(config.spool.folder).glob("*.sqlite"))
    yield check_files([*([config_file] if passwords else []), *spools], [config_file, *files_of(config.link)])
    if (sources := time_sources()) is not None:
        yield sources
    listened = [place(endpoint) for endpoint in config.link.listen]
    yield check_ports(open_ports(port for _, port in listened), listened)
    yield check_program()


def check_camera(box: BoxConfig, camera: CameraConfig, config_file: Path, clock: ClockMonitor) -> Iterator[Check]:
    """The camera's lens, its frames and their time, its detector and how long it takes."""
    name = "lens"
    try:
        lens = load_lens(camera, config_file)
        name = "mask"
        mask = load_mask(camera, config_file, lens.size_px)
    except ConfigError as error:
        yield failure(f"{name} {camera.id}", error)
        return
    yield Check(
        f"lens {camera.id}", "ok", f"{lens.model}, focal length {lens.intrinsics[0]:.1f} px, rms {lens.rms_px} px"
    )
    if mask is not None:
        yield Check(
            f"mask {camera.id}", "ok", f"{len(mask.regions)} regions, {mask.share:.1%} of the picture is left out"
        )
    stop = threading.Event()
    try:
        detector = open_detector(box.detector_of(camera), background=not is_lossless(camera), mask=mask)
        facts = CameraFacts(camera.id, lens, camera.readout_s, box.gate_of(camera), epoch=0)
        pipeline = Pipeline(facts, detector, clock.bound_s)
        source = open_source(camera, colour=detector.colour, stop=stop, date=clock.date)
    except SkyfixError as error:
        yield failure(f"camera {camera.id}", error)
        return
    try:
        yield from _check_frames(camera, source, pipeline, clock, box.detector_of(camera))
    except SkyfixError as error:
        yield failure(f"camera {camera.id}", error)
    finally:
        stop.set()
        source.close()
        detector.close()


def _check_frames(
    camera: CameraConfig, source: FrameSource, pipeline: Pipeline, clock: ClockMonitor, detector: DetectorConfig
) -> Iterator[Check]:
    """What the camera's first frames show of it and of its detector. Raises SkyfixError."""
    spent_s: list[float] = []
    deadline_s = time.monotonic() + STREAM_SETTLES_S
    while (frame := source.read()) is not None:
        began_s = time.perf_counter()
        pipeline.step(frame)
        spent_s.append(time.perf_counter() - began_s)
        last = frame
        sure = frame.bound_s is not None and not source.remarks
        settled = not source.live or sure or time.monotonic() > deadline_s
        if settled and len(spent_s) >= TRIED_FRAMES:
            break
    if not spent_s:
        yield Check(f"camera {camera.id}", "fail", f"{shown(camera.source.path)} holds no frame", "play it to check it")
        return
    bound_s = total_bound_s(last, clock.bound_s())
    uncertainty = "unknown" if bound_s is None else f"{bound_s * 1e3:.3g} ms"
    level: HealthLevel = "warn" if bound_s is None or last.time_source == "arrival" else "ok"
    action = "expect a worse position, or give it a better source of time" if level == "warn" else ""
    size = f"{last.size_px[0]} x {last.size_px[1]}"
    reason = f"{size} frames, timed by {last.time_source}, uncertain by {uncertainty}"
    remarks = [*source.remarks, *([pipeline.order] if pipeline.order else [])]
    if remarks:
        level, action = "warn", remarks[0].action
        reason = "; ".join([reason, *(remark.what for remark in remarks)])
    yield Check(f"camera {camera.id}", level, reason, action)
    pace = f"{sorted(spent_s)[len(spent_s) // 2] * 1e3:.1f} ms a frame"
    yield Check(f"detector {camera.id}", "ok", f"{pace}, {where_it_runs(detector)}")


def check_receiver(receiver: Receiver, progress: Telling = silent) -> Check:
    """What the receiver says once it has had the time to say it."""
    status = try_receiver(receiver, progress)
    return Check("gnss", status.level, f"{status.state}: {status.reason}", status.action)


def check_spool_folder(folder: Path) -> Check:
    """Whether what is seen can be kept."""
    probe = folder / ".writable"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        return Check(
            "spool", "fail", f"{folder} cannot be written to ({error})", "create it for this user, or name another"
        )
    return Check("spool", "ok", f"{folder} can be written to")


def check_link(config: BoxConfig) -> Check:
    """Whether a Zenoh session opens and a base station is there."""
    who = "the base station"
    with (
        Link(config.link, name="check") as link,
        Counterpart(link, config.bearer, station_key(config.site)) as base,
    ):
        if base.meets(LINK_S):
            return Check("link", "ok", f"{who} answers")
        why = base.why_not(who)
    kept = "; observations are kept meanwhile" if config.spool and why.absent else ""
    reason = f"no base station of site {config.site} answers: {why.reason}"
    return Check("link", "warn" if why.absent else "fail", reason, why.action + kept)


def failure(name: str, error: SkyfixError) -> Check:
    """An error as a finding."""
    return Check(name, "fail", f"{error.where}: {error.what}", error.action)
