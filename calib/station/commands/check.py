"""`base-station check`: the configuration as it is understood, and one line for each thing it depends on."""

import argparse
import datetime as dt
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from calib.reference_frame import frame_of_all
from calib.station.archive.state_store import StateStore
from calib.station.commands.arguments import add_config, folder_of
from calib.station.config import MIN_CAMERAS, BaseConfig, Geodetic, load
from calib.station.core.calibration import Phase
from calib.station.core.positions import check_frame
from calib.station.core.stored_state import StoredState
from calib.station.inputs.receiver import receiver_settings
from calib.station.outputs.output import Output, StationStanding
from calib.station.outputs.registry import OutputHost, open_output, wanted
from calib.station.own_clock import check_own_clock
from calib.station.status.asking import Running, running_station
from calib.station.status.https import check_page
from calib.station.survey.assessment import contradictions
from calib.station.survey.in_force import frames_in_force, is_survey, survey_file, twice_given, with_survey
from calib.station.survey.store import load_survey
from edge.audit import check_files, check_ports, check_program, open_ports, time_sources
from edge.clock.monitor import read_clock
from edge.common.errors import ConfigError
from edge.common.health import SEVERITY, Check
from edge.gnss.geoid import SITE_ZERO_M, contradiction, undulation_m
from edge.gnss.receiver import Receiver
from edge.gnss.trial import try_receiver
from edge.link.ports import place, why_not_free
from edge.link.security import Bearer, check_security, files_of

SENDS: Final = 3  # times that an output sends, so that what the network says of the first is heard
HEARS_WITHIN_S: Final = 0.15  # of each; what is well says nothing
MOST_LOOKED_AT: Final = 200  # recordings, the newest
VERDICTS: Final = {"ok": "PASS", "warn": "WARN", "fail": "FAIL"}
ASKED_FOR: Final = ("versions", "recordings", "frame")  # findings that only the station that runs can have
LINE: Final = "{0.verdict:4}  {0.name:22}  {0.reason}"


@dataclass(frozen=True)
class Line:
    """One dependency: PASS, WARN or FAIL, why, and what to do."""

    verdict: str
    name: str
    reason: str
    action: str = ""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station check`."""
    add_config(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write it out; 1 if something fails."""
    config, folder = load(arguments.config), folder_of(arguments.config)
    sys.stdout.write(json.dumps(msgspec.to_builtins(config), indent=2) + "\n")
    lines = list(examine(config, folder))
    for line in lines:
        sys.stdout.write(LINE.format(line) + (f" -> {line.action}" if line.action else "") + "\n")
    return int(any(line.verdict == "FAIL" for line in lines))


def examine(config: BaseConfig, folder: Path) -> Iterator[Line]:
    """All dependencies of a configuration."""
    yield from _positions(config, folder)
    yield _writable("state folder", folder / config.state_folder)
    yield from _memory(config, folder)
    if config.recording.folder is not None:
        yield _disk(folder / config.recording.folder, config.recording.min_free_mb)
    else:
        yield Line("WARN", "recording", "off", "set [recording] folder to be able to solve again afterwards")
    security = check_security(config.link, dt.datetime.now(dt.UTC), Bearer(config.site.name, "station"))
    yield Line(VERDICTS[security.level], security.name, security.reason, security.action)
    clock = check_own_clock(read_clock(config.clock), config.clock)
    yield Line(VERDICTS[clock.level], clock.name, clock.reason, clock.action)
    for found in _audit(config, folder):
        yield Line(VERDICTS[found.level], found.name, found.reason, found.action)
    running = running_station(config, folder)
    if running is not None and running.site == config.site.name:
        yield from _told_by(running)  # ports and receivers are its own: it is asked, not fought
        return
    yield from _frame(config, folder)
    yield from _outputs(config, folder)
    yield from _receiver(config)
    for endpoint in config.link.listen:
        yield _listen(endpoint)
    if config.status.port is not None:
        yield _port("status page", config.status.host, config.status.port)


def _audit(config: BaseConfig, folder: Path) -> Iterator[Check]:
    """Whether the machine is as closed as the configuration says."""
    recordings = folder / config.recording.folder if config.recording.folder else None
    private = [] if recordings is None else sorted(recordings.glob("*.mcap"))[-MOST_LOOKED_AT:]
    state = folder / config.state_folder
    yield check_files(private, [folder, state, *state.glob("*.toml"), *state.glob("*.json"), *files_of(config.link)])
    if (sources := time_sources()) is not None:
        yield sources
    listened = [place(endpoint) for endpoint in config.link.listen]
    if config.status.port is not None:
        listened.append((config.status.host, config.status.port))
    holders = [port for _, port in listened]
    served = (endpoint.url for endpoint in config.mavlink.endpoint if endpoint.url.startswith("tcpin:"))
    listened += [(host.strip("[]"), int(port)) for host, _, port in (url[6:].rpartition(":") for url in served)]
    yield check_ports(open_ports(holders), listened)
    if (page := check_page(config)) is not None:
        yield page
    yield check_program()


def _told_by(running: Running) -> Iterator[Line]:
    reason = f"version {running.version} runs here: {running.phase}"
    verdict = "FAIL" if running.phase == Phase.BLIND else "PASS"
    yield Line(verdict, "running station", f"{reason}, {running.reason}" if running.reason else reason, running.action)
    for found in running.health.items:
        if found.name in ASKED_FOR:
            well = found.level == "ok" and not found.action
            yield Line("PASS" if well else "WARN", found.name, found.reason, found.action)
    for camera in running.cameras:
        if said := camera.receiver:
            yield Line(_verdict(said.level), f"receiver {camera.id}", said.reason, said.action)
    for each in running.endpoints:
        name = f"{each.output} {each.url}"
        if each.last_error:
            yield Line("WARN", name, each.last_error, "see whether the receiver is there")
        else:
            yield Line("PASS", name, f"{each.content}, {each.sent} sent".lstrip(", "))


def _verdict(level: str) -> str:
    """Of a level by another version's words."""
    return next((verdict for known, verdict in VERDICTS.items() if known == level), "WARN")


def _positions(config: BaseConfig, folder: Path) -> Iterator[Line]:
    try:
        cameras, twice = with_survey(config, folder), twice_given(config, folder)
    except ConfigError as error:
        yield Line("FAIL", "survey", f"{error.where}: {error.what}", error.action)
        return
    file = survey_file(config, folder)
    source = "no survey file" if file is None else f"survey file {file}"
    surveyed = [camera.id for camera in cameras.values() if camera.position is not None]
    reason = f"{len(surveyed)} of {len(cameras)} cameras have a position ({source})"
    if len(surveyed) >= MIN_CAMERAS:
        yield Line("PASS", "survey", reason)
    else:
        action = "base-station survey, or wait for the boxes"
        yield Line("WARN", "survey", f"{reason}; the others' boxes must send RTK fixes", action)
    yield from _undulation(config, [camera.position for camera in cameras.values() if camera.position is not None])
    yield from _contradicted(file)
    if twice:
        reason = f"{', '.join(twice)}: the position in the configuration is used, not the one in {file}"
        yield Line("WARN", "survey", reason, "take `position` out of the configuration, or `base-station survey drop`")


def _contradicted(file: Path | None) -> Iterator[Line]:
    """What the survey itself has against its positions."""
    if file is None or not is_survey(file):
        return
    for found in contradictions(load_survey(file)):
        yield Line("WARN", "survey", found)


def _frame(config: BaseConfig, folder: Path) -> Iterator[Line]:
    """Whether what is sent has a place on the Earth to better than a metre."""
    try:
        frames = frames_in_force(config, folder)
    except ConfigError:
        return  # what is wrong with the survey has been said
    if frames:
        said = check_frame(frame_of_all(frames.values()))
        yield Line("WARN" if said.action else "PASS", said.name, said.reason, said.action)


def _undulation(config: BaseConfig, surveyed: list[Geodetic]) -> Iterator[Line]:
    """Whether the site's geoid is the one that EGM96 has there: a wrong sign draws every target on the wrong height."""
    given_m, places = config.site.undulation_m, [*([config.site.origin] if config.site.origin else []), *surveyed]
    if given_m is None or not places:
        return
    if wrong := contradiction(given_m, undulation_m(*places[0][:2]), "EGM96 says", zero_from_m=SITE_ZERO_M):
        action = "set [site] undulation_m to the geoid's height above the ellipsoid there"
        yield Line("WARN", "undulation", f"site.undulation_m is {wrong}", action)


def _memory(config: BaseConfig, folder: Path) -> Iterator[Line]:
    names = {camera.id for camera in config.camera}
    network = StateStore(folder / config.state_folder).stored_network(names)
    if network is None:
        yield Line("PASS", "stored calibration", "none: the station calibrates from the first flight")
    else:
        yield Line("PASS", "stored calibration", f"{len(network.cameras)} cameras, {network.fingerprint}")


def _outputs(config: BaseConfig, folder: Path) -> Iterator[Line]:
    """Each receiver by itself: opened as the station opens it, and closed again."""
    host = OutputHost(config.site, folder, StoredState(), lambda _topic, _payload: None, lambda _ticks: None)
    outputs = wanted(config)
    if not outputs:
        yield Line("WARN", "output", "none: nothing is sent", "add [[mavlink.endpoint]] or [output.NAME]")
    besides: dict[str, Check] = {}
    for one in (each for output in outputs for each in output.one_by_one()):
        try:
            with ExitStack() as stack:
                output = open_output(one, host, stack)
                yield _sent(one.title, output)
                besides |= {check.name: check for check in output.checks(time.time_ns()) if check.name != one.title}
        except ConfigError as error:
            yield Line("FAIL", one.title, error.what, error.action)
    for check in besides.values():
        yield Line(VERDICTS[check.level], check.name, check.reason, check.action)


def _sent(title: str, output: Output) -> Line:
    """What an output says once it has sent what it sends every second: as the station does, from this machine."""
    nobody = StationStanding(time.time_ns(), 0, Phase.COLLECTING, "being checked", "", "", (), None, 0, 0)
    worst = Check("", "ok", "")
    for _ in range(SENDS):
        output.second(nobody, [], time.time_ns())
        output.wait(HEARS_WITHIN_S)
        output.receive(time.time_ns(), time.time_ns(), lambda _: False)
        # What the network says of a dialling comes with the next call.
        worst = max([worst, *output.checks(time.time_ns())], key=lambda check: SEVERITY[check.level])
    if worst.level == "ok":
        return Line("PASS", title, "+".join(each.content for each in output.status) or "opened")
    return Line(VERDICTS[worst.level], title, worst.reason, worst.action)


def _receiver(config: BaseConfig) -> Iterator[Line]:
    """The rover's receiver, if there is one, read until it is clear how it is."""
    if config.receiver is None:
        return
    settings = receiver_settings(config.receiver, where="receiver")
    status = try_receiver(Receiver(settings, undulation_m=config.site.undulation_m))
    yield Line(VERDICTS[status.level], "receiver", f"{status.state}: {status.reason}", status.action)


def _writable(name: str, folder: Path) -> Line:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return Line("PASS", name, str(folder))
    except OSError as error:
        return Line("FAIL", name, f"{folder}: {error.strerror}", "give this user the right to write there")


def _disk(folder: Path, min_free_mb: int) -> Line:
    line = _writable("recording", folder)
    if line.verdict != "PASS":
        return line
    free_mb = shutil.disk_usage(folder).free // 10**6
    if free_mb < min_free_mb:
        return Line("FAIL", "recording", f"{free_mb} MB free in {folder}", f"free {min_free_mb} MB")
    return Line("PASS", "recording", f"{free_mb} MB free in {folder}")


def _listen(endpoint: str) -> Line:
    return _port(f"link {endpoint}", *place(endpoint))


def _port(name: str, host: str, port: int) -> Line:
    error = why_not_free(host, port)
    if error is not None:
        action = "end the program that holds it (is a base-station running?), or choose another"
        return Line("FAIL", name, os.strerror(error.errno or 0), action)
    return Line("PASS", name, f"{host}:{port} is free")
