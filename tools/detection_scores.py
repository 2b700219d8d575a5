"""How good detections are, held against labelled boxes: overlap measures and centre measures side by side.

The hazard is a measure that answers another question. Of a 6 px object whose label is twice too large, a box that is
right to half a pixel has an overlap of 0.25 and counts as a miss at every usual threshold; the base station wants its
centre. So both are given: the overlap measures of the method this project implements (means over IoU 0.50 to 0.95, and
the area under the success curve of Wu et al. 2013, which needs no scores), and whether the centre lies in the label.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

IOU_THRESHOLDS: Final = tuple(round(0.50 + 0.05 * k, 2) for k in range(10))
SUCCESS_THRESHOLDS: Final = tuple(round(0.05 * k, 2) for k in range(20))
FALSE_RATES: Final = (0.01, 0.1, 1.0)  # false positives a frame at which recall is read


@dataclass(frozen=True)
class Boxes:
    """Boxes of many frames. frame: `(N,)` numbers; box_px: `(N, 4)` left, top, width, height; score: `(N,)`."""

    frame: NDArray[np.int64]
    box_px: Floats
    score: Floats

    def __len__(self) -> int:
        return len(self.frame)


@dataclass(frozen=True)
class Scores:
    """What `evaluate` finds. Rates are 0..1; `recall_at` belongs to FALSE_RATES; the counts are what they rest on."""

    iou_precision: float
    iou_recall: float
    iou_f1: float
    auc: float
    centre_precision: float
    centre_recall: float
    centre_f1: float
    centre_ap: float
    recall_at: tuple[float, ...]
    false_per_frame: float
    frames: int
    truths: int
    detections: int


def no_boxes() -> Boxes:
    """No box at all."""
    return Boxes(np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0))


def together(parts: list[Boxes], frames: list[int]) -> Boxes:
    """Boxes of several clips of so many frames, as those of one long clip."""
    starts = [sum(frames[:k]) for k in range(len(frames))]
    return Boxes(
        np.concatenate([part.frame + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([part.box_px for part in parts]),
        np.concatenate([part.score for part in parts]),
    )


def overlaps(found: Floats, truth: Floats) -> Floats:
    """`(N, M)` intersection over union of boxes `(N, 4)` and `(M, 4)`."""
    low = np.maximum(found[:, None, :2], truth[None, :, :2])
    high = np.minimum(found[:, None, :2] + found[:, None, 2:], truth[None, :, :2] + truth[None, :, 2:])
    size = np.clip(high - low, 0, None)
    common = size[..., 0] * size[..., 1]
    union = (found[:, 2] * found[:, 3])[:, None] + (truth[:, 2] * truth[:, 3])[None] - common
    iou: Floats = np.divide(common, np.maximum(union, 1e-12))
    return iou


def centred(found: Floats, truth: Floats) -> Floats:
    """`(N, M)` 1 where the centre of box n lies in box m, else 0."""
    centre = found[:, None, :2] + found[:, None, 2:] / 2
    inside = (centre >= truth[None, :, :2]) & (centre <= truth[None, :, :2] + truth[None, :, 2:])
    return np.asarray(inside.all(axis=2), np.float64)


def match(agreement: Floats, least: float) -> Flags:
    """Which of N detections, best first, are hits: each takes the free truth it agrees with best, if by `least`."""
    free = np.ones(agreement.shape[1], bool)
    hit = np.zeros(len(agreement), bool)
    for n, row in enumerate(agreement):
        candidates = np.where(free, row, -1.0)
        if len(candidates) and candidates.max() >= least:
            hit[n] = True
            free[int(candidates.argmax())] = False
    return hit


def average_precision(hit: Flags, score: Floats, truths: int) -> float:
    """Area under precision (made monotonous) over recall, detections taken by falling score."""
    if not truths or not len(hit):
        return 0.0
    recall, precision = _curve(hit, score, truths)
    steps = np.diff(np.concatenate([[0.0], recall]))
    return float(np.sum(steps * np.maximum.accumulate(precision[::-1])[::-1]))


def recall_at(hit: Flags, score: Floats, truths: int, allowed: float) -> float:
    """The most recall to be had with at most `allowed` false positives in all."""
    if not truths or not len(hit):
        return 0.0
    order = np.argsort(-score, kind="stable")
    recall = np.cumsum(hit[order]) / truths
    within = np.cumsum(~hit[order]) <= allowed
    return float(recall[within].max()) if within.any() else 0.0


def _curve(hit: Flags, score: Floats, truths: int) -> tuple[Floats, Floats]:
    order = np.argsort(-score, kind="stable")
    right = np.cumsum(hit[order])
    return right / truths, right / np.arange(1, len(hit) + 1)


def evaluate(found: Boxes, truth: Boxes, frames: int) -> Scores:
    """Score detections of `frames` frames, of which each truth row labels an object in one."""
    order = np.lexsort((-found.score, found.frame))
    found = Boxes(found.frame[order], found.box_px[order], found.score[order])
    by_iou = {least: np.zeros(len(found), bool) for least in sorted({*IOU_THRESHOLDS, *SUCCESS_THRESHOLDS})}
    by_centre = np.zeros(len(found), bool)
    for rows, labels in _frames(found, truth):
        iou = overlaps(found.box_px[rows], truth.box_px[labels])
        for least, hit in by_iou.items():
            hit[rows] = match(iou, max(least, 1e-9))
        by_centre[rows] = match(centred(found.box_px[rows], truth.box_px[labels]), 1.0)
    precision, recall, f1 = np.mean([_rates(by_iou[least], len(truth)) for least in IOU_THRESHOLDS], axis=0).tolist()
    success = [_rates(by_iou[least], len(truth))[1] for least in SUCCESS_THRESHOLDS]
    centre_precision, centre_recall, centre_f1 = _rates(by_centre, len(truth))
    return Scores(
        iou_precision=precision,
        iou_recall=recall,
        iou_f1=f1,
        auc=float(np.mean(success)),
        centre_precision=centre_precision,
        centre_recall=centre_recall,
        centre_f1=centre_f1,
        centre_ap=average_precision(by_centre, found.score, len(truth)),
        recall_at=tuple(recall_at(by_centre, found.score, len(truth), rate * frames) for rate in FALSE_RATES),
        false_per_frame=float((~by_centre).sum() / max(frames, 1)),
        frames=frames,
        truths=len(truth),
        detections=len(found),
    )


def _frames(found: Boxes, truth: Boxes) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Row numbers of detections and truths of every frame that has both."""
    shared = np.intersect1d(found.frame, truth.frame)
    return [(np.flatnonzero(found.frame == frame), np.flatnonzero(truth.frame == frame)) for frame in shared]


def _rates(hit: Flags, truths: int) -> tuple[float, float, float]:
    """Precision, recall and their harmonic mean. Nothing said is nothing wrong: precision 1."""
    right = int(hit.sum())
    precision = right / len(hit) if len(hit) else 1.0
    recall = right / truths if truths else 1.0
    return precision, recall, 2 * precision * recall / max(precision + recall, 1e-12)
