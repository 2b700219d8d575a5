"""Score detections against labels, raw against gated: `python -m tools.evaluate_detections labels raw=... gated=...`.

Labels and detections are a CSV file each, or a folder each of files of the same names. Columns: `frame, x_px, y_px,
width_px, height_px` (left, top, size; frames counted from 0), detections also `score` (1 where there is none).
"""

import argparse
import csv
import dataclasses
import json
import sys
from pathlib import Path

import numpy as np

from edge.common.errors import SkyfixError
from tools.detection_scores import FALSE_RATES, Boxes, Scores, evaluate, no_boxes, together
from tools.train.footage import first_number

COLUMNS = ("frame", "x_px", "y_px", "width_px", "height_px")


def read_boxes(path: Path) -> Boxes:
    """The boxes of a CSV file. Raises SkyfixError naming file and what is wrong."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(line for line in file if not line.startswith("#"))
            rows = [[float(row[name]) for name in COLUMNS] + [float(row.get("score") or 1.0)] for row in reader]
    except OSError as error:
        raise SkyfixError(f"cannot be read ({error.strerror})", where=str(path), action="check the path") from error
    except (KeyError, TypeError, ValueError) as error:
        action = f"give the columns {', '.join(COLUMNS)}, all numbers"
        raise SkyfixError(f"is not a table of boxes ({error})", where=str(path), action=action) from error
    if not rows:
        return no_boxes()
    table = np.array(rows)
    if not np.isfinite(table).all():
        raise SkyfixError("holds a value that is no number", where=str(path), action="remove that row")
    return Boxes(table[:, 0].astype(np.int64), table[:, 1:5], table[:, 5])


def read_all(path: Path) -> dict[str, Boxes]:
    """Boxes by clip: of a folder's CSV files, or of one file. Raises SkyfixError if there is none."""
    if path.is_file():
        return {"": read_boxes(path)}
    found = {each.stem: read_boxes(each) for each in sorted(path.glob("*.csv"))}
    if not found:
        raise SkyfixError("holds no CSV file", where=str(path), action="give a table of boxes or a folder of them")
    return found


def from_zero(boxes: Boxes, frames: int) -> Boxes:
    """Labels of a clip of so many frames, counted from 0 whatever their table counts from."""
    number = boxes.frame - first_number(boxes.frame.tolist(), frames)
    return Boxes(number[number >= 0], boxes.box_px[number >= 0], boxes.score[number >= 0])


def score(truth: dict[str, Boxes], found: dict[str, Boxes], frames: dict[str, int]) -> Scores:
    """Scores over all clips that have labels; a clip without detections counts as one in which nothing was found."""
    clips = sorted(truth)
    lengths = [frames[clip] for clip in clips]
    detections = together([found.get(clip, no_boxes()) for clip in clips], lengths)
    return evaluate(detections, together([truth[clip] for clip in clips], lengths), sum(lengths))


def lengths(truth: dict[str, Boxes], found: list[dict[str, Boxes]]) -> dict[str, int]:
    """Frames of every labelled clip: up to the last in which anything is labelled or found."""
    last = {clip: boxes.frame.max(initial=-1) for clip, boxes in truth.items()}
    for each in found:
        for clip in truth.keys() & each.keys():
            last[clip] = max(last[clip], each[clip].frame.max(initial=-1))
    return {clip: int(number) + 1 for clip, number in last.items()}


def table(results: dict[str, Scores]) -> str:
    """The scores side by side, one column a set of detections."""
    names = [name for name in Scores.__dataclass_fields__ if name != "recall_at"]
    at = names.index("false_per_frame")
    rows = [["", *results]]
    for name in names[:at]:
        rows.append([name, *(f"{getattr(scores, name):.3f}" for scores in results.values())])
    for k, rate in enumerate(FALSE_RATES):
        rows.append([f"recall at {rate:g} false a frame", *(f"{s.recall_at[k]:.3f}" for s in results.values())])
    for name in names[at:]:
        rows.append([name, *(f"{getattr(scores, name):.6g}" for scores in results.values())])
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return "\n".join(
        "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
        for row in rows
    )


def main(argv: list[str] | None = None) -> int:
    """Read, score, print. 0 done, 1 it could not be done."""
    parser = argparse.ArgumentParser(prog="python -m tools.evaluate_detections", description=__doc__)
    parser.add_argument("labels", type=Path, help="CSV file, or folder of CSV files")
    parser.add_argument("detections", nargs="+", metavar="NAME=PATH", help="a column of the table: raw=out/raw")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the scores there as well")
    options = parser.parse_args(argv)
    named = [entry.partition("=") for entry in options.detections]
    if any(not path for _, _, path in named):
        parser.error("give every set of detections as NAME=PATH")
    try:
        truth = read_all(options.labels)
        found = {name: read_all(Path(path)) for name, _, path in named}
    except SkyfixError as error:
        print(error, file=sys.stderr)
        return 1
    frames = lengths(truth, list(found.values()))
    results = {name: score(truth, each, frames) for name, each in found.items()}
    print(table(results))
    if options.json:
        options.json.write_text(json.dumps({k: dataclasses.asdict(v) for k, v in results.items()}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
