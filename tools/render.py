"""Render a seeded scene to one short video a camera, with labels: `python -m tools.render scene.toml -o out/scene`."""

import argparse
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2

from calib.simulation.description import Simulation
from calib.simulation.simulation import watch
from calib.station.archive.scene_file import load, located, shipped
from edge.common.errors import SkyfixError
from tools.rendering.footage import Frame, footage

HEADER = "frame,x_px,y_px,width_px,height_px,u_px,v_px,object,kind,visible"
CODEC = "mp4v"  # the one that OpenCV's headless wheels write everywhere


def render_camera(scene: Simulation, number: int, folder: Path) -> Path:
    """Write `<camera>.mp4` and `<camera>.csv` of one camera into an existing folder; the video's path.

    The video has a constant frame rate, so frames that the scene would drop are shown. Raises SkyfixError if the video
    cannot be written.
    """
    # One thread: several cameras are rendered at once, and threads that outnumber cores only wait for each other.
    cv2.setNumThreads(1)
    camera = scene.camera[number]
    path = folder / f"{camera.id}.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CODEC), camera.frame_rate_hz, camera.size_px)
    if not writer.isOpened():
        raise SkyfixError(f"no {CODEC} video can be written", where=str(path), action="check the folder and its disk")
    lines = [HEADER]
    try:
        for frame in footage(watch(scene), number):
            writer.write(frame.image)
            lines += _label_rows(frame)
    finally:
        writer.release()
    (folder / f"{camera.id}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _label_rows(frame: Frame) -> list[str]:
    return [
        ",".join([str(frame.number), *(f"{value:.3f}" for value in (*label.box_px, *label.centre_px))])
        + f",{label.name},{label.kind},{label.visible:.2f}"
        for label in frame.labels
    ]


def render(scene: Simulation, folder: Path, done: Callable[[Path], None] = lambda path: None) -> list[Path]:
    """Render all cameras of a scene, as many at a time as there are cores; `done` is told of each that is ready."""
    folder.mkdir(parents=True, exist_ok=True)
    workers = min(len(scene.camera), os.cpu_count() or 1)
    # Spawned, not forked: a fork of a process in which OpenCV has threads never ends.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, initializer=_end_quietly) as pool:
        try:
            jobs = [pool.submit(render_camera, scene, number, folder) for number in range(len(scene.camera))]
            for job in jobs:
                done(job.result())
        except BaseException:
            # Leaving the pool waits for its jobs; whoever interrupts us does not want to.
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise
        return [job.result() for job in jobs]


def _end_quietly() -> None:
    """A worker that is interrupted has nothing to say; its parent has."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.render", description=__doc__)
    parser.add_argument("scene", help=f"the scene's TOML file, or one that comes with it: {', '.join(shipped())}")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER", help="where videos and labels go")
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Read the scene, render it."""
    arguments = _arguments(argv)
    try:
        scene = load(located(arguments.scene))
        print(f"{scene.name}, seed {scene.seed}: {len(scene.camera)} cameras")
        render(scene, arguments.output, lambda path: print(f"written {path}", flush=True))
    except SkyfixError as error:
        print(error, file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{arguments.output}: cannot be written ({error.strerror}); choose another -o", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
