"""Detection scores against cases worked out by hand, and the table that shows raw beside gated."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.common.errors import SkyfixError
from tools import evaluate_detections as program
from tools.detection_scores import (
    Boxes,
    average_precision,
    centred,
    evaluate,
    match,
    no_boxes,
    overlaps,
    recall_at,
    together,
)


def boxes(*rows: tuple[float, ...]) -> Boxes:
    """Rows of frame, left, top, width, height, score."""
    table = np.array(rows, float).reshape(-1, 6)
    return Boxes(table[:, 0].astype(np.int64), table[:, 1:5], table[:, 5])


TRUTH = boxes((0, 10, 10, 10, 10, 1), (1, 20, 10, 10, 10, 1), (2, 30, 10, 10, 10, 1), (3, 40, 10, 10, 10, 1))


def test_overlap_is_common_area_over_joint_area() -> None:
    found = np.array([[0.0, 0, 10, 10], [5, 0, 10, 10], [100, 0, 10, 10]])
    assert overlaps(found, np.array([[0.0, 0, 10, 10]]))[:, 0] == pytest.approx([1.0, 50 / 150, 0.0])


def test_the_labels_themselves_score_one() -> None:
    scores = evaluate(TRUTH, TRUTH, 4)
    rates = (scores.iou_precision, scores.iou_recall, scores.iou_f1, scores.auc, scores.centre_f1, scores.centre_ap)
    assert rates == pytest.approx((1.0,) * 6)
    assert scores.false_per_frame == 0


def test_half_the_thresholds_are_met_by_an_overlap_between_them() -> None:
    # A box of 7.2 x 10 in one of 10 x 10: overlap 0.72, so 0.50 to 0.70 are met and 0.75 to 0.95 are not.
    found = boxes((0, 11, 10, 7.2, 10, 0.9))
    scores = evaluate(found, boxes((0, 10, 10, 10, 10, 1)), 1)
    assert (scores.iou_precision, scores.iou_recall, scores.iou_f1) == pytest.approx((0.5, 0.5, 0.5))
    assert scores.auc == pytest.approx(15 / 20)  # 0 to 0.70 of twenty thresholds
    assert scores.centre_ap == 1


def test_an_object_is_found_once_and_the_second_box_is_false() -> None:
    found = boxes((0, 10, 10, 10, 10, 0.9), (0, 11, 10, 10, 10, 0.8))
    scores = evaluate(found, TRUTH, 4)
    assert (scores.centre_precision, scores.centre_recall) == (0.5, 0.25)
    assert scores.false_per_frame == 0.25


def test_two_objects_share_no_detection() -> None:
    truth = np.array([[0.0, 0, 10, 10], [6, 0, 10, 10]])
    assert match(centred(np.array([[4.0, 0, 8, 10]]), truth), 1.0).tolist() == [True]
    assert match(centred(np.array([[4.0, 0, 8, 10], [4.0, 0, 8, 10]]), truth), 1.0).tolist() == [True, True]


def test_average_precision_by_hand() -> None:
    # Hits at ranks 1 and 3 of 2 truths: precision 1 up to half the recall, 2/3 from there on.
    hit, score = np.array([True, False, True]), np.array([0.9, 0.8, 0.7])
    assert average_precision(hit, score, 2) == pytest.approx(0.5 * 1 + 0.5 * 2 / 3)


def test_recall_is_read_where_the_false_ones_run_out() -> None:
    hit, score = np.array([True, False, True, False, True]), np.array([0.9, 0.8, 0.7, 0.6, 0.5])
    assert [recall_at(hit, score, 3, allowed) for allowed in (0, 1, 2)] == pytest.approx([1 / 3, 2 / 3, 1])


def test_order_of_the_rows_does_not_matter() -> None:
    found = boxes((0, 10, 10, 10, 10, 0.3), (1, 90, 10, 10, 10, 0.9), (2, 31, 10, 10, 10, 0.5), (2, 80, 9, 3, 3, 0.6))
    turned = Boxes(found.frame[::-1], found.box_px[::-1], found.score[::-1])
    assert evaluate(found, TRUTH, 4) == evaluate(turned, TRUTH, 4)


@given(st.integers(0, 2**31))
def test_rates_stay_rates(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(0, 12))
    found = Boxes(random.integers(0, 5, count), random.uniform(0, 50, (count, 4)), random.random(count))
    scores = evaluate(found, TRUTH, 5)
    for name in ("iou_precision", "iou_recall", "iou_f1", "auc", "centre_precision", "centre_recall", "centre_ap"):
        assert 0 <= getattr(scores, name) <= 1
    assert scores.centre_ap <= scores.centre_recall + 1e-12
    assert list(scores.recall_at) == sorted(scores.recall_at)


def test_nothing_found_and_nothing_there() -> None:
    missed = evaluate(no_boxes(), TRUTH, 4)
    assert (missed.centre_precision, missed.centre_recall, missed.centre_ap, missed.auc) == (1, 0, 0, 0)
    quiet = evaluate(no_boxes(), no_boxes(), 4)
    assert (quiet.centre_precision, quiet.centre_recall) == (1, 1)


def test_clips_do_not_answer_for_each_other() -> None:
    first, second = boxes((0, 10, 10, 10, 10, 1)), boxes((0, 60, 10, 10, 10, 1))
    joined = together([first, second], [3, 3])
    swapped = together([second, first], [3, 3])
    assert joined.frame.tolist() == [0, 3]
    assert evaluate(swapped, joined, 6).centre_recall == 0


def write(path: Path, *rows: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(rows) + "\n")
    return path


def test_the_command_shows_raw_beside_gated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header = "frame,x_px,y_px,width_px,height_px"
    write(tmp_path / "labels/a.csv", header, "0,10,10,10,10", "1,20,10,10,10")
    write(tmp_path / "labels/b.csv", header, "4,10,10,10,10")
    write(tmp_path / "raw/a.csv", header + ",score", "0,10,10,10,10,0.9", "1,20,10,10,10,0.8", "1,70,10,10,10,0.7")
    write(tmp_path / "gated/a.csv", header, "0,10,10,10,10", "1,20,10,10,10")
    out = tmp_path / "scores.json"
    command = [str(tmp_path / "labels"), f"raw={tmp_path / 'raw'}", f"gated={tmp_path / 'gated'}", "--json", str(out)]
    assert program.main(command) == 0
    shown = capsys.readouterr().out
    assert "centre_precision" in shown
    assert shown.splitlines()[0].split() == ["raw", "gated"]
    scores = json.loads(out.read_text())
    # Clip b has labels and no detections: its object counts as missed in both.
    assert scores["raw"]["centre_recall"] == pytest.approx(2 / 3)
    assert scores["raw"]["centre_precision"] == pytest.approx(2 / 3)
    assert scores["gated"]["centre_precision"] == 1
    assert scores["gated"]["frames"] == 7


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("frame,x_px,y_px,width_px\n0,1,2,3\n", "height_px"),
        ("frame,x_px,y_px,width_px,height_px\n0,1,2,three,4\n", "three"),
        ("frame,x_px,y_px,width_px,height_px\n0,1,2,nan,4\n", "no number"),
    ],
)
def test_a_broken_table_is_named(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "broken.csv"
    path.write_text(text)
    with pytest.raises(SkyfixError, match=reason) as caught:
        program.read_boxes(path)
    assert str(path) in str(caught.value)


def test_a_missing_folder_is_said_on_stderr(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main([str(tmp_path / "none"), f"raw={tmp_path}"]) == 1
    assert "none" in capsys.readouterr().err
