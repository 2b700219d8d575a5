"""`make demo`: a simulated flight over three tripods, seen by real programs, end to end, on this computer.

A seeded scene is rendered to three videos. Three `edge-node` processes play them in real time, each with an RTK
receiver on a pseudo-terminal; a `base-station` process calibrates itself from what they share and sends MAVLink; an
independent listener compares what it receives with the truth. Exit code 0 only if positions came within 1 m RMSE.
"""

import argparse
import json
import shutil
import signal
import sys
import time
import urllib.error
import urllib.request
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Final

import msgspec

from calib.simulation.description import Simulation
from calib.simulation.simulation import Watched, watch
from calib.station.archive.scene_file import load, located
from edge.common.errors import SkyfixError
from tools.demonstration import picture, site
from tools.demonstration.processes import Program, Programs
from tools.demonstration.receivers import receivers
from tools.demonstration.score import PASS_M, Score, errors_m, followed_m, score
from tools.demonstration.screen import Screen, View
from tools.doubles.listener import Listener
from tools.doubles.ports import free_port
from tools.render import render

SCENE: Final = located("demo")
OUTPUT: Final = Path("out") / "demo"
MARKER: Final = ".skyfix-demo"  # in a folder that may be emptied
SETTLE_S: Final = 12.0  # from starting the programs to the first frame: models load, sessions open, RTK averages
LINGER_S: Final = 15.0  # after the last frame, until a box that does not end is given up
REFRESH_S: Final = 0.5
SOLVE_S: Final = 120.0  # for the report at the end


@dataclass(frozen=True)
class Site:
    """The running demo."""

    scene: Simulation
    watched: Watched
    folder: Path
    ports: site.Ports
    listener: Listener
    start_unix_ns: int

    @property
    def elapsed_s(self) -> float:
        """Seconds since the flight began; negative before."""
        return (time.time_ns() - self.start_unix_ns) * 1e-9


def demonstrate(scene: Simulation, folder: Path, *, reuse_video: bool) -> tuple[Score, dict[str, int]]:
    """Run everything: the score, and how many of each MAVLink message came. Raises SkyfixError naming what failed."""
    _empty(folder, but="video")
    watched = watch(scene)
    videos = _videos(scene, folder / "video", reuse=reuse_video)
    with ExitStack() as stack:
        listener = stack.enter_context(Listener())
        antennas = [site.antenna_enu(camera) for camera in scene.camera]
        devices = stack.enter_context(receivers(antennas, scene.origin, scene.seed))
        programs = stack.enter_context(Programs(folder / "log"))
        start_unix_ns = time.time_ns() + round(SETTLE_S * 1e9)
        ports = site.Ports(free_port(), listener.port, free_port())
        running = Site(scene, watched, folder, ports, listener, start_unix_ns)
        base, boxes = _start(running, programs, videos, devices)
        print(f"started base-station and {len(boxes)} edge-node; logs in {folder / 'log'}")
        _watch(running, programs, boxes)
        base.stop()
        programs.check()
        _report(folder, programs)
        if listener.positions:
            picture.draw(watched, folder, listener.positions, start_unix_ns)
        result = score(listener.positions, watched.flights, start_unix_ns, scene.origin)
        return result, dict(listener.counts)


def _empty(folder: Path, but: str) -> None:
    """A folder for the demo, emptied of an earlier one. Raises SkyfixError for a folder that is somebody else's."""
    marker = folder / MARKER
    if folder.exists() and any(folder.iterdir()) and not marker.exists():
        raise SkyfixError("holds something else", where=str(folder), action="give -o an empty or a new folder")
    folder.mkdir(parents=True, exist_ok=True)
    marker.touch()
    for child in folder.iterdir():
        if child.is_dir() and child.name != but:
            shutil.rmtree(child)
        elif child.is_file() and child != marker:
            child.unlink()


def _videos(scene: Simulation, folder: Path, *, reuse: bool) -> list[Path]:
    """The scene's videos; those of an earlier demo of the same scene if that is wanted."""
    said, videos = folder / "scene.json", [folder / f"{camera.id}.mp4" for camera in scene.camera]
    if reuse and said.exists() and said.read_bytes() == msgspec.json.encode(scene):
        print(f"using the videos in {folder}", flush=True)
        return videos
    shutil.rmtree(folder, ignore_errors=True)
    began = time.monotonic()
    print(f"rendering {len(videos)} videos of {scene.duration_s:g} s, seed {scene.seed}", flush=True)
    render(scene, folder)
    said.write_bytes(msgspec.json.encode(scene))
    print(f"rendered in {time.monotonic() - began:.0f} s: {folder}", flush=True)
    return videos


def _start(running: Site, programs: Programs, videos: list[Path], devices: list[str]) -> tuple[Program, list[Program]]:
    base_file = running.folder / "base.toml"
    base_file.write_text(site.base(running.scene, running.ports), encoding="utf-8")
    base = programs.start("base-station", "base-station", "run", "--config", str(base_file))
    boxes = []
    for camera, video, device in zip(running.scene.camera, videos, devices, strict=True):
        file = running.folder / f"{camera.id}.toml"
        text = site.box(
            running.scene.name, camera, site.Inputs(video.resolve(), device, running.start_unix_ns), running.ports
        )
        file.write_text(text, encoding="utf-8")
        boxes.append(programs.start(f"edge-node-{camera.id}", "edge-node", "run", "--config", str(file)))
    return base, boxes


def _watch(running: Site, programs: Programs, boxes: list[Program]) -> None:
    """Show how things are until every video has ended. Raises SkyfixError if a program fails or does not end."""
    screen = Screen()
    duration_s = running.watched.duration_s
    while any(box.code is None for box in boxes):
        programs.check()
        if running.elapsed_s > duration_s + LINGER_S:
            names = ", ".join(box.name for box in boxes if box.code is None)
            raise SkyfixError("did not end with its video", where=names, action="see its log in the log folder")
        positions = running.listener.positions
        error = errors_m(positions, running.watched.flights, running.start_unix_ns, running.scene.origin)
        followed = followed_m(positions, error)
        status = _status(running.ports.status)
        screen.show(View(running.elapsed_s, duration_s, status, positions, followed, time.time_ns()))
        time.sleep(REFRESH_S)


def _status(port: int) -> dict[str, Any] | None:
    """The station's own words, or None while it is not up."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/status.json", timeout=1.0) as answer:
            found: dict[str, Any] | None = json.load(answer)
            return found
    except (urllib.error.URLError, TimeoutError, ConnectionError, json.JSONDecodeError):
        return None


def _report(folder: Path, programs: Programs) -> None:
    """Solve the recording once more as a whole: what `base-station solve` says of it."""
    recordings = sorted((folder / "recording").glob("*.mcap"))
    if not recordings:
        raise SkyfixError("left no recording", where="base-station", action=f"see {folder / 'log'}")
    print("solving the recording for the report", flush=True)
    solve = programs.start("solve", "base-station", "solve", str(recordings[-1]), "-o", str(folder / "solved"))
    if not programs.wait([solve], SOLVE_S):
        raise SkyfixError(f"took longer than {SOLVE_S:.0f} s", where="base-station solve", action=f"see {solve.log}")


def verdict(result: Score, folder: Path, messages: dict[str, int]) -> str:
    """What a person wants to know at the end."""
    text = [""]
    for found in result.objects:
        if found.positions == 0:
            text.append(f"{found.name}: no position")
            continue
        text.append(
            f"{found.name}: first position {found.first_s:.1f} s after the flight began; {found.positions} positions; "
            f"RMSE {found.rmse_m:.2f} m, median {found.median_m:.2f} m, worst {found.maximum_m:.2f} m"
        )
    if result.nobodys:
        text.append(f"targets that follow nothing: {len(result.nobodys)}")
    if result.latency_ms is not None:
        text.append("latency from exposure to MAVLink: p50 {:.0f} ms, p99 {:.0f} ms".format(*result.latency_ms))
    text.append("received: " + ", ".join(f"{count} {name}" for name, count in sorted(messages.items())))
    places = [*sorted((folder / "recording").glob("*.mcap")), folder / "solved" / "report.html", folder / "picture.png"]
    text += [f"{place.suffix[1:]:5s} {place}" for place in places if place.exists()]
    if result.passed:
        text.append(f"PASS: positions within {PASS_M:g} m RMSE of the truth")
    else:
        text.append(f"FAIL: {'no position came' if not result.objects else f'RMSE is above {PASS_M:g} m'}")
    return "\n".join(text)


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.demo", description=__doc__)
    parser.add_argument("--scene", type=Path, default=SCENE, help="another scene to fly (TOML)")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, metavar="FOLDER", help="emptied first")
    parser.add_argument("--reuse-video", action="store_true", help="do not render again what is rendered already")
    return parser.parse_args(argv)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main(argv: list[str] | None = None) -> int:
    """Run the demo; 0 if it passed."""
    arguments = _arguments(argv)
    signal.signal(signal.SIGTERM, _interrupt)
    began = time.monotonic()
    try:
        scene = load(arguments.scene)
        result, messages = demonstrate(scene, arguments.output, reuse_video=arguments.reuse_video)
    except SkyfixError as error:
        print(f"\ndemo: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ndemo: interrupted; everything it started has been stopped", file=sys.stderr)
        return 1
    print(verdict(result, arguments.output, messages))
    print(f"the demo took {time.monotonic() - began:.0f} s")
    return 0 if result.passed else 1


if __name__ == "__main__":
    sys.exit(main())
