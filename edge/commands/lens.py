"""`edge-node lens`: from pictures or a video of a board to a lens file, with a report of what was left out and why."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from edge.boards import Board, BoardView, parse_board
from edge.capture.files import IMAGE_SUFFIXES, VideoFile
from edge.capture.frame import Image
from edge.common.atomic import write_atomically
from edge.common.errors import LensError, SourceError
from edge.lens_fit import LensFit, fit_lens

VIDEO_PICTURES: Final = 40  # taken from a video, evenly: more only repeat each other
EMPTY_CELLS_WARN: Final = 0.35  # share of the image without a corner beyond which the lens is guessed there
SHADES: Final = " .:+#"  # coverage, from none to plenty
PLENTY: Final = 16  # corners in a cell


def measure(arguments: argparse.Namespace) -> str:
    """Measure a lens and write its file; the report. Raises ConfigError, LensError, SourceError."""
    board = parse_board(arguments.board, arguments.pattern, arguments.square_mm)
    views, size_px, missed = find_views(board, pictures(arguments.images))
    fit = fit_lens(views, size_px, arguments.model)
    text = lens_toml(fit, missed)
    try:
        write_atomically(arguments.output, text.encode())
    except OSError as error:
        raise LensError(
            f"cannot be written ({error})", where=str(arguments.output), action="name another file"
        ) from error
    return f"{report(fit, missed)}\nwritten to {arguments.output}"


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
    video = VideoFile(path, t0_unix_ns=0, bound_s=None)
    stamps = iter(video.grab, None)
    count = sum(1 for _ in stamps)
    video.close()
    chosen = set(np.linspace(0, count - 1, min(count, VIDEO_PICTURES)).round().astype(int).tolist())
    video = VideoFile(path, t0_unix_ns=0, bound_s=None)
    for index in range(count):
        t_unix_ns = video.grab()
        if index in chosen and t_unix_ns is not None and (frame := video.retrieve(t_unix_ns)) is not None:
            yield f"{Path(path).name} frame {index}", frame.image
    video.close()


def find_views(
    board: Board, named: Iterator[tuple[str, Image | None]]
) -> tuple[list[BoardView], tuple[int, int], dict[str, str]]:
    """Views of the board, their size, and the pictures that show none, with the reason. Raises LensError."""
    views: list[BoardView] = []
    missed: dict[str, str] = {}
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
            missed[name] = "the board was not found"
        else:
            views.append(view)
    if size_px is None:
        raise LensError("holds no picture that can be read", where="pictures of the board", action="give image files")
    return views, size_px, missed


def report(fit: LensFit, missed: dict[str, str]) -> str:
    """What was found, in words and a map."""
    fx, fy, cx, cy = fit.lens.intrinsics
    lines = [
        f"{fit.lens.model} lens, {fit.lens.size_px[0]} x {fit.lens.size_px[1]}, from {len(fit.view_rms_px)} pictures",
        f"focal length {fx:.2f}, {fy:.2f} px, one sigma {fit.lens.focal_sigma_px:.2f} px; centre {cx:.2f}, {cy:.2f} px",
        f"distortion {', '.join(f'{value:.6f}' for value in fit.lens.distortion)}",
        f"rms {fit.rms_px:.3f} px; of pictures held out {fit.held_out_rms_px:.3f} px",
    ]
    lines += [f"left out: {name}: {reason}" for name, reason in {**missed, **fit.rejected}.items()]
    lines.append(f"corners seen in {np.mean(fit.coverage > 0):.0%} of the image:")
    lines += ["  |" + "".join(_shade(count) * 2 for count in row) + "|" for row in fit.coverage]
    if np.mean(fit.coverage == 0) > EMPTY_CELLS_WARN:
        lines.append("WARN the empty parts are extrapolated: take pictures with the board there")
    return "\n".join(lines)


def _shade(count: float) -> str:
    return SHADES[min(len(SHADES) - 1, int(np.ceil(count / PLENTY * (len(SHADES) - 1))))]


def lens_toml(fit: LensFit, missed: dict[str, str]) -> str:
    """The lens file."""
    lens = fit.lens
    lines = [
        "# Written by `edge-node lens`.",
        f'model = "{lens.model}"',
        f"intrinsics = {_numbers(lens.intrinsics)}",
        f"distortion = {_numbers(lens.distortion)}",
        f"size_px = [{lens.size_px[0]}, {lens.size_px[1]}]",
        f"rms_px = {fit.rms_px:.4f}",
        f"focal_sigma_px = {max(lens.focal_sigma_px or 0.0, 1e-3):.4f}",
        "",
        "[report]",
        f"pictures = {len(fit.view_rms_px)}",
        f"held_out_rms_px = {fit.held_out_rms_px:.4f}",
        f"coverage = {float(np.mean(fit.coverage > 0)):.3f}",
        "",
        "[report.left_out]",
    ]
    lines += [f"{_quoted(name)} = {_quoted(reason)}" for name, reason in {**missed, **fit.rejected}.items()]
    lines += ["", "[report.view_rms_px]"]
    lines += [f"{_quoted(name)} = {rms:.4f}" for name, rms in fit.view_rms_px.items()]
    return "\n".join(lines) + "\n"


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(repr(float(f"{value:.9g}")) for value in values) + "]"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
