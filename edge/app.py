"""The camera box's command line: `edge-node [run|check|lens|detect]`.

Exit codes: 0 done, 1 it could not be done (the reason and the next action on stderr), 2 wrong usage or configuration.
"""

import argparse
import contextlib
import logging
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import msgspec

from edge import __version__
from edge.common.errors import ConfigError, SkyfixError
from edge.common.progress import write_over
from edge.config import BoxConfig, load, load_box
from edge.lens import DEFAULT_LENS, measured_names

if TYPE_CHECKING:
    from edge.camera import CameraWorker

DONE, FAILED, MISUSED = 0, 1, 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        return int(arguments.command(arguments))
    except ConfigError as error:
        print(f"edge-node: {error}", file=sys.stderr)
        return MISUSED
    except SkyfixError as error:
        print(f"edge-node: {error}", file=sys.stderr)
        return FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="edge-node",
        description="The camera box: what its cameras see becomes timestamped pixel tracks on the network.",
        epilog="exit codes: 0 done, 1 it could not be done, 2 wrong usage or configuration",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s (skyfix) {__version__}")
    commands = parser.add_subparsers(required=True, metavar="run|check|lens|detect")
    _add_run(commands)
    _add_check(commands)
    _add_lens(commands)
    _add_detect(commands)
    return parser


def _add_run(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    run = commands.add_parser("run", help="watch and publish until told to stop, or until every recording has ended")
    run.add_argument("--config", required=True, type=Path, metavar="FILE", help="the box's configuration (TOML)")
    run.add_argument("--camera", metavar="ID", help="only this one of the configuration's cameras")
    run.add_argument(
        "--preview", metavar="FILE|PORT", help="write a low-rate picture to FILE, or serve it on http://127.0.0.1:PORT/"
    )
    run.set_defaults(command=_run)


def _add_check(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    check = commands.add_parser(
        "check", help="print the resolved configuration and one PASS, WARN or FAIL line per dependency"
    )
    check.add_argument("--config", required=True, type=Path, metavar="FILE", help="the box's configuration (TOML)")
    check.set_defaults(command=_check)


def _add_lens(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    lens = commands.add_parser("lens", help="measure a lens from pictures of a chessboard (Zhang's method)")
    lens.add_argument("images", nargs="+", metavar="IMAGES", help="pictures, folders of pictures, or a video")
    lens.add_argument("--board", required=True, metavar="COLSxROWS", help="inner corners of the board, such as 9x6")
    lens.add_argument("--pattern", choices=("chessboard", "charuco"), default="chessboard", help="default: chessboard")
    lens.add_argument("--square-mm", type=float, default=1.0, metavar="S", help="side of a square; any value serves")
    lens.add_argument("--model", choices=measured_names(), default=DEFAULT_LENS, help=f"default: {DEFAULT_LENS}")
    lens.add_argument("-o", "--output", required=True, type=Path, metavar="LENS.toml", help="where to write the lens")
    lens.set_defaults(command=_lens)


def _add_detect(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    detect = commands.add_parser(
        "detect", help="write what the model sees in a recording: rows and a sheet of pictures"
    )
    detect.add_argument("source", metavar="VIDEO|FOLDER", help="a video file, or a folder of pictures")
    detect.add_argument(
        "-o", "--output", required=True, type=Path, metavar="TRACKS", help="track folder: TRACKS/tracks/CAMERA.csv"
    )
    detect.add_argument("--camera", metavar="ID", help="its name there; of a configuration, which camera's (the first)")
    detect.add_argument("--model", type=Path, metavar="FILE", help="ONNX model; default: the shipped one")
    detect.add_argument("--mask", type=Path, metavar="FILE", help="regions that are left out")
    detect.add_argument(
        "--config", type=Path, metavar="FILE", help="take lens, mask, detector and gate of a box's camera"
    )
    detect.add_argument("--t0", type=int, metavar="UNIX_NS", help="UTC of the first frame, ns since 1970")
    detect.add_argument("--fps", type=float, metavar="F", help="frames a second, where the recording has no times")
    detect.set_defaults(command=_detect)


def _run(arguments: argparse.Namespace) -> int:
    # Imported here: `edge-node lens` and `--help` need neither a network nor a model.
    from edge.link.zenoh_log import ZenohLog  # noqa: PLC0415
    from edge.node import Node  # noqa: PLC0415

    config = _only(load_box(arguments.config), arguments.camera, arguments.config)
    logging.basicConfig(
        level=config.log_level.upper(), format="%(asctime)s %(levelname)s %(name)s: %(message)s", stream=sys.stderr
    )
    stop = threading.Event()
    _stop_on_signals(stop)
    before = set(threading.enumerate())
    with ZenohLog(), Node(config, arguments.config, stop) as node, _preview(arguments.preview, node.workers[0]):
        if node.run():
            code = DONE
        else:
            misused = any(isinstance(worker.error, ConfigError) for worker in node.workers)
            code = MISUSED if misused else FAILED
    _leave_what_is_stuck(set(threading.enumerate()) - before, code)
    return code


def _leave_what_is_stuck(stuck: set[threading.Thread], code: int) -> None:
    """End at once if a driver or a model still holds a thread: torn out of C++ later, it would abort the process."""
    if stuck:
        logging.getLogger(__name__).info("leaving %s", ", ".join(sorted(thread.name for thread in stuck)))
        logging.shutdown()
        os._exit(code)


def _preview(where: str | None, worker: "CameraWorker") -> contextlib.AbstractContextManager[object]:
    """The preview of a camera; of the first one, where a box has several and none was chosen."""
    from edge.pictures.preview import Preview  # noqa: PLC0415

    return Preview(where, worker.glance, worker.mask) if where else contextlib.nullcontext()


def _only(config: BoxConfig, camera: str | None, file: Path) -> BoxConfig:
    if camera is None:
        return config
    chosen = tuple(one for one in config.camera if one.id == camera)
    if not chosen:
        names = ", ".join(one.id for one in config.camera)
        raise ConfigError(f"has no camera {camera}", where=str(file), action=f"choose one of {names}")
    return msgspec.structs.replace(config, camera=chosen)


def _stop_on_signals(stop: threading.Event) -> None:
    """The first signal ends in order; a second one ends at once."""

    def handle(number: int, _: FrameType | None) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)

    signal.signal(signal.SIGTERM, handle)
    signal.signal(signal.SIGINT, handle)


def _check(arguments: argparse.Namespace) -> int:
    from edge.commands.check import check_box, resolved  # noqa: PLC0415

    config = load(arguments.config, BoxConfig)  # a lens that is not measured yet is a finding, beside all others
    print(resolved(config))
    worst = DONE
    for check in check_box(config, arguments.config, _show_progress):
        _show_progress("")
        word = {"ok": "PASS", "warn": "WARN", "fail": "FAIL"}[check.level]
        print(f"{word} {check.name}: {check.reason}" + (f"; {check.action}" if check.action else ""))
        worst = FAILED if check.level == "fail" else worst
    return worst


def _show_progress(line: str) -> None:
    write_over(line, sys.stderr)


def _lens(arguments: argparse.Namespace) -> int:
    from edge.commands.lens import measure  # noqa: PLC0415

    print(measure(arguments))
    return DONE


def _detect(arguments: argparse.Namespace) -> int:
    from edge.commands.detect import detect  # noqa: PLC0415

    logging.basicConfig(level="ERROR", format="%(name)s: %(message)s", stream=sys.stderr)
    print(detect(arguments))
    return DONE


if __name__ == "__main__":
    sys.exit(main())
