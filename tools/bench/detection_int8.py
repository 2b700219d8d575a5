"""Whether the 8-bit model equals the float one at the size it runs at: `python -m tools.bench.detection_int8 DDT`.

No real labelled 1080p footage of a clean licence was found. Six clips side by side fill a 1920 x 1080 frame, and the
same frames are shown to both models. Quantising was once right at 640 px and blind in three quarters of such a frame.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.common.errors import SkyfixError
from edge.config import SHIPPED_MODEL
from edge.detector.session import open_model
from edge.detector.skyfix import StackNet
from tools.bench.detection import LOWEST_SCORE
from tools.detection_scores import Boxes, evaluate
from tools.evaluate_detections import from_zero, read_all
from tools.train.footage import frame_count, read_split, stacks

COLUMNS: Final = 3
ROWS: Final = 2
FRAME_PX: Final = (1920, 1080)
Stack = NDArray[np.uint8]


def mosaics(folder: Path, clips: list[str], every: int) -> Iterator[tuple[Stack, Boxes]]:
    """Every so many frames of six clips as `(1080, 1920, 3)` stacks, with the labels of all six."""
    labels = read_all(folder / "labels")
    videos = {clip: folder / "videos" / f"{clip}.mp4" for clip in clips}
    truth = {clip: from_zero(labels[clip], frame_count(video)) for clip, video in videos.items()}
    for together in zip(*(stacks(video) for video in videos.values()), strict=False):
        number = together[0][0]
        if number % every:
            continue
        out = np.full((FRAME_PX[1], FRAME_PX[0], 3), 128, np.uint8)
        boxes = []
        for place, (clip, (_, images, _)) in enumerate(zip(clips, together, strict=True)):
            height, width = images[0].shape
            left, top = place % COLUMNS * width, place // COLUMNS * height
            out[top : top + height, left : left + width] = cv2.merge(images)
            here = truth[clip].box_px[truth[clip].frame == number]
            boxes.append(here + np.array([left, top, 0, 0]))
        box_px = np.concatenate(boxes)
        yield out, Boxes(np.zeros(len(box_px), np.int64), box_px, np.ones(len(box_px)))


def look(net: StackNet, stack: Stack) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Boxes `(N, 4)` left, top, width, height and scores `(N,)` of a frame."""
    found = net.run(stack[None], LOWEST_SCORE)[0]
    return np.column_stack([found.centre_px + 0.5 - found.size_px / 2, found.size_px]), found.score


def measure(folder: Path, clips: list[str], models: dict[str, StackNet], every: int) -> dict[str, tuple[float, float]]:
    """Average precision and recall at 0.1 false a frame of each model, over the same frames."""
    truth: list[Boxes] = []
    found: dict[str, list[Boxes]] = {name: [] for name in models}
    for first in range(0, len(clips) - COLUMNS * ROWS + 1, COLUMNS * ROWS):
        for stack, boxes in mosaics(folder, clips[first : first + COLUMNS * ROWS], every):
            number = len(truth)
            truth.append(Boxes(boxes.frame + number, boxes.box_px, boxes.score))
            for name, net in models.items():
                box_px, score = look(net, stack)
                found[name].append(Boxes(np.full(len(score), number, np.int64), box_px, score))
    scores = {name: evaluate(_joined(each), _joined(truth), len(truth)) for name, each in found.items()}
    return {name: (each.centre_ap, each.recall_at[1]) for name, each in scores.items()}


def _joined(parts: list[Boxes]) -> Boxes:
    return Boxes(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("frame", "box_px", "score")))


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench.detection_int8", description=__doc__)
    parser.add_argument("clips", type=Path, help="folder with videos/, labels/ and split.json")
    parser.add_argument(
        "--model", type=Path, default=SHIPPED_MODEL, help="the 8-bit one; NAME-fp32.onnx lies beside it"
    )
    parser.add_argument("--every", type=int, default=15)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    floats = options.model.with_name(f"{options.model.stem}-fp32.onnx")
    try:
        models = {path.name: StackNet(open_model(path)) for path in (options.model, floats)}
        results = measure(options.clips, read_split(options.clips, "test"), models, options.every)
    except SkyfixError as error:
        print(error, file=sys.stderr)
        return 1
    for name, (precision, recall) in results.items():
        print(f"{name:20} AP {precision:.3f}, recall at 0.1 false a frame {recall:.3f}, 1920 x 1080")
    return 0


if __name__ == "__main__":
    sys.exit(main())
