"""`edge-node lens`: from pictures or a video of a board to a lens file, with a report of what was left out and why."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from edge.capture.folder import IMAGE_SUFFIXES
from edge.capture.frame import Image
from edge.capture.video import VideoFile
from edge.common.atomic import write_atomically
from edge.common.errors import LensError, SourceError
from edge.common.progress import Progress
from edge.lens_fit.boards import Board, BoardView, parse_board
from edge.lens_fit.fit import fit_lens
from edge.lens_fit.report import lens_toml, report

TELLING_PICTURES: Final = 3  # that all show a board of another size
VIDEO_PICTURES: Final = 40  # taken from a video, evenly: more only repeat each other


def measure(arguments: argparse.Namespace) -> str:
    """Measure a lens and write its file; the report. Raises ConfigError, LensError, SourceError."""
    board = parse_board(arguments.board, arguments.pattern, arguments.square_mm)
    with Progress("pictures looked at", 0) as progress:
        views, size_px, missed = find_views(board, _counted(pictures(arguments.images), progress))
    fit = fit_lens(views, size_px, arguments.model)
    text = lens_toml(fit, missed)
    try:
        write_atomically(arguments.output, text.encode())
    except OSError as error:
        raise LensError(
            f"cannot be written ({error})", where=str(arguments.output), action="name another file"
        ) from error
    return f"{report(fit, missed)}\nwritten to {arguments.output}"


def _counted(named: Iterator[tuple[str, Image | None]], progress: Progress) -> Iterator[tuple[str, Image | None]]:
    for count, one in enumerate(named, start=1):
        yield one
        progress.at(count)


def pictures(paths: Sequence[str]) -> Iterator[tuple[str, Image | None]]:
    """Names and grey pictures of files, folders and videos; None for a file that is no picture. Raises SourceError."""
    for path in map(Path, paths):
        if path.is_dir():
            yield from pictures(sorted(str(file) for file in path.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES))
        elif path.suffix.lower() in IMAGE_SUFFIXES:
            if not path.is_file():
                raise SourceError("no such picture", where=str(path), action="check the path")
            yield path.name, cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        else:
            yield from _video_pictures(str(path))


def _video_pictures(path: str) -> Iterator[tuple[str, Image]]:
    video = VideoFile(path, t0_unix_ns=0, bound_s=None, dated=False)
    stamps = iter(video.grab, None)
    count = sum(1 for _ in stamps)
    video.close()
    chosen = set(np.linspace(0, count - 1, min(count, VIDEO_PICTURES)).round().astype(int).tolist())
    video = VideoFile(path, t0_unix_ns=0, bound_s=None, dated=False)
    for index in range(count):
        t_unix_ns = video.grab()
        if index in chosen and t_unix_ns is not None and (frame := video.retrieve(t_unix_ns)) is not None:
            yield f"{Path(path).name} frame {index}", frame.image
    video.close()


def find_views(
    board: Board, named: Iterator[tuple[str, Image | None]]
) -> tuple[list[BoardView], tuple[int, int], dict[str, str]]:
    """Views of the board, their size, and the pictures that show none, with the reason. Raises LensError.

    Where the first pictures all show a board of one other size there is no waiting for the rest.
    """
    views: list[BoardView] = []
    missed: dict[str, str] = {}
    others: list[str] = []
    size_px: tuple[int, int] | None = None
    for name, image in named:
        if image is None:
            missed[name] = "cannot be read"
            continue
        here = (image.shape[1], image.shape[0])
        size_px = size_px or here
        if here != size_px:
            missed[name] = f"is {here[0]} x {here[1]}, the others are {size_px[0]} x {size_px[1]}"
        elif (view := board.find(name, image)) is None:
            other = board.other_size(image)
            missed[name] = f"it shows a board of {other}" if other else "the board was not found"
            others.append(other)
            if not views and len(others) >= TELLING_PICTURES and other and others.count(other) == len(others):
                raise LensError(
                    f"the first {len(others)} show a board of {other} inner corners, not the one that was given",
                    where="pictures of the board",
                    action=f"type --board {other}",
                )
        else:
            views.append(view)
    if size_px is None:
        raise LensError("holds no picture that can be read", where="pictures of the board", action="give image files")
    return views, size_px, missed
