"""Detection on labelled clips held out from training: `python -m tools.bench.detection ../shared/data/ddt`.

Four rows of figures for the drones and four for everything: the model on whole frames at native size and at a third, as
full-frame mode looks at them (what comes reduced is also enlarged), the box's own two stages, and what its gate lets
through. Labels are 1.5 to 3 times the object, so the centre measures count. Detections are written to --out as tables
for `tools.evaluate_detections`.

Two thirds of the clips number their labels from 1 (tools/train/footage.py). They are counted from 0 here; the drones
are scored a second time by the tables to the letter, by which the first frame of such a clip has a drone and no label.
"""

import argparse
import csv
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from edge.capture.frame import Image, Picture
from edge.common.errors import SkyfixError, SourceError
from edge.config import SHIPPED_MODEL, DetectorConfig, GateConfig
from edge.detector.detections import Detections, nothing
from edge.detector.look import look
from edge.detector.opening import open_detector
from edge.detector.session import open_model
from edge.detector.skyfix import StackNet
from edge.gate import TrackRow, make_gate
from tools.detection_scores import Boxes, Scores, no_boxes
from tools.evaluate_detections import from_zero, read_all, score
from tools.train.footage import read_split, stacks

START_UNIX_NS: Final = 1_780_000_000 * 10**9
LOWEST_SCORE: Final = 0.02  # of whole frames: average precision needs the doubtful ones too
ROWS: Final = ("whole frames", "whole frames, 1/3 size", "two stages", "gated")
CLIP_KINDS: Final = {"DRONE": "drone", "BIRD": "bird", "AIRPLANE": "aeroplane", "HELICOPTER": "helicopter"}
COLUMNS: Final = ("frame", "x_px", "y_px", "width_px", "height_px", "score")


@dataclass(frozen=True)
class ClipResult:
    """What was found in one clip, by row of figures; its frames; and the class its clearest track was voted, if any."""

    clip: str
    frames: int
    found: dict[str, Boxes]
    vote: str | None


def frames_of(video: Path) -> Iterator[Picture]:
    """The frames of a clip, grey, stamped by its frame rate."""
    capture = cv2.VideoCapture(str(video))
    if not capture.isOpened():
        raise SourceError("the video does not open", where=str(video), action="give the folder that holds videos/")
    period_ns = round(1e9 / (capture.get(cv2.CAP_PROP_FPS) or 30.0))
    number = 0
    while (image := _next(capture)) is not None:
        yield Picture(START_UNIX_NS + number * period_ns, image, "file")
        number += 1
    capture.release()


def _next(capture: cv2.VideoCapture) -> Image | None:
    ok, frame = capture.read()
    return np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), np.uint8) if ok else None


def measure(folder: Path, clip: str, model: str, every: int) -> ClipResult:
    """Run one clip through all four."""
    cv2.setNumThreads(1)
    video = folder / "videos" / f"{clip}.mp4"
    found = {ROWS[0]: whole(video, model, 1.0, every), ROWS[1]: whole(video, model, 1 / 3, every)}
    found[ROWS[2]], rows, frames, names = staged(video, model)
    found[ROWS[3]] = of_rows(rows, video)
    return ClipResult(clip, frames, found, vote(rows, names))


def whole(video: Path, model: str, scale: float, every: int) -> Boxes:
    """Detections of the model on every so many whole frames, in pixels of the original."""
    net, found = StackNet(open_model(model)), []
    for number, stack, _ in stacks(video):
        if number % every:
            found.append(nothing(len(net.class_names)))
            continue
        images = [_scaled(grey, scale) for grey in stack]
        found.append(look(net, images, LOWEST_SCORE))
    return _boxes(found, scale)


def _scaled(image: Image, scale: float) -> Image:
    if scale == 1.0:
        return image
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)


def staged(video: Path, model: str) -> tuple[Boxes, list[TrackRow], int, tuple[str, ...]]:
    """What the two stages find as a box runs them, the rows its gate gives, how many frames, the classes' names."""
    detector = open_detector(DetectorConfig(model=model), background=False)
    gate, found, rows = None, [], []
    for frame in frames_of(video):
        gate = gate or make_gate(GateConfig(), frame.size_px, detector.track_score)
        found.append(detector.detect(frame, gate.expected(frame.t_unix_ns)))
        rows += gate.step(frame.t_unix_ns, found[-1])
    return _boxes(found, 1.0), rows, len(found), detector.class_names


def _boxes(found: list[Detections], scale: float) -> Boxes:
    """Left, top, width, height counted from the corner of the first pixel, as labels are."""
    if not any(len(each) for each in found):
        return no_boxes()
    frame = np.concatenate([np.full(len(each), k, np.int64) for k, each in enumerate(found)])
    centre = np.concatenate([each.centre_px for each in found])
    size = np.concatenate([each.size_px for each in found])
    boxes = np.column_stack([centre + 0.5 - size / 2, size]) / scale
    return Boxes(frame, boxes, np.concatenate([each.score for each in found]))


def of_rows(rows: list[TrackRow], video: Path) -> Boxes:
    """The rows of a gate, interpolated ones too, as boxes of frames."""
    capture = cv2.VideoCapture(str(video))
    period_ns = round(1e9 / (capture.get(cv2.CAP_PROP_FPS) or 30.0))
    capture.release()
    if not rows:
        return no_boxes()
    table = np.array([[row.u_px, row.v_px, row.width_px, row.height_px, row.score] for row in rows])
    frame = np.array([(row.t_unix_ns - START_UNIX_NS) // period_ns for row in rows], np.int64)
    return Boxes(frame, np.column_stack([table[:, :2] + 0.5 - table[:, 2:4] / 2, table[:, 2:4]]), table[:, 4])


def vote(rows: list[TrackRow], names: tuple[str, ...]) -> str | None:
    """The class of the track that was seen most surely for longest, as it stood at its end; None without a track."""
    measured = [row for row in rows if row.status == "confirmed"]
    if not measured:
        return None
    weight: dict[int, float] = {}
    for row in measured:
        weight[row.track] = weight.get(row.track, 0.0) + row.score
    clearest = max(sorted(weight), key=weight.__getitem__)
    last = [row for row in measured if row.track == clearest][-1]
    return names[int(np.argmax(last.classes))] if last.classes else None


def figures(results: list[ClipResult], labels: dict[str, Boxes], every: int) -> dict[str, Scores]:
    """Scores of some clips, by row of figures; those of whole frames over the frames that were looked at."""
    scores = {}
    for row in ROWS:
        step = every if row.startswith("whole") else 1
        frames = {result.clip: -(-result.frames // step) for result in results}
        truth = {result.clip: _thinned(labels[result.clip], step) for result in results}
        scores[row] = score(truth, {result.clip: _thinned(result.found[row], step) for result in results}, frames)
    return scores


def _thinned(boxes: Boxes, step: int) -> Boxes:
    """The boxes of every step-th frame, frames counted anew."""
    kept = boxes.frame % step == 0
    return Boxes(boxes.frame[kept] // step, boxes.box_px[kept], boxes.score[kept])


def show(title: str, scores: dict[str, Scores]) -> None:
    """One table."""
    print(f"\n{title}\n{'':24}   AP  R@0.01 R@0.1  R@1.0   P     R    false/frame")
    for row, s in scores.items():
        recall = "  ".join(f"{value:.3f}" for value in s.recall_at)
        rates = f"{s.centre_precision:.3f} {s.centre_recall:.3f}"
        print(f"{row:24} {s.centre_ap:.3f}  {recall}  {rates}  {s.false_per_frame:.3f}")


def show_votes(results: list[ClipResult]) -> None:
    """Which clips were called what."""
    kinds = {result.clip: CLIP_KINDS[result.clip.split("_")[1]] for result in results}
    drones = [result for result in results if kinds[result.clip] == "drone"]
    others = [result for result in results if kinds[result.clip] != "drone"]
    called = sum(result.vote == "drone" for result in drones)
    wrongly = sum(result.vote == "drone" for result in others)
    print(f"\nclips: {called} of {len(drones)} drones called drone, {wrongly} of {len(others)} others called drone")
    for result in others:
        print(f"  {result.clip}: {result.vote or 'no track'}")


def write(results: list[ClipResult], out: Path) -> None:
    """A folder of tables for each row of figures."""
    for row in ROWS:
        folder = out / row.replace(" ", "_").replace(",", "").replace("/", "_")
        folder.mkdir(parents=True, exist_ok=True)
        for result in results:
            boxes = result.found[row]
            with (folder / f"{result.clip}.csv").open("w", newline="") as file:
                table = csv.writer(file)
                table.writerow(COLUMNS)
                for frame, box, value in zip(boxes.frame, boxes.box_px, boxes.score, strict=True):
                    table.writerow([int(frame), *(f"{x:.3f}" for x in box), f"{value:.4f}"])


def main(argv: list[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench.detection", description=__doc__)
    parser.add_argument("clips", type=Path, help="folder with videos/, labels/ and split.json")
    parser.add_argument("--part", default="test", choices=["test", "train"])
    parser.add_argument("--model", default=str(SHIPPED_MODEL))
    parser.add_argument("--match", default="", help="only clips whose name holds this")
    parser.add_argument("--every", type=int, default=5, help="whole frames: look at one in so many (default 5)")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, help="where the detections are written as tables")
    options = parser.parse_args(argv)
    try:
        clips = [clip for clip in read_split(options.clips, options.part) if options.match in clip]
        labels = read_all(options.clips / "labels")
        with ProcessPoolExecutor(options.workers) as pool:
            jobs = [pool.submit(measure, options.clips, clip, options.model, options.every) for clip in clips]
            results = [job.result() for job in jobs]
    except SkyfixError as error:
        print(error, file=sys.stderr)
        return 1
    as_numbered = labels
    labels = labels | {result.clip: from_zero(labels[result.clip], result.frames) for result in results}
    print(f"{options.model}, {len(results)} clips of {options.part}, {sum(r.frames for r in results)} frames")
    drones = [result for result in results if "_DRONE_" in result.clip]
    if drones:
        show("drones", figures(drones, labels, options.every))
        show("drones, the labels' frames numbered as they stand", figures(drones, as_numbered, options.every))
    show("all", figures(results, labels, options.every))
    show_votes(results)
    if options.out:
        write(results, options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
