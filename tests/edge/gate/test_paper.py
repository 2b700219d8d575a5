"""The published rules, clause by clause."""

import numpy as np
import pytest

from edge.detector.detections import Detections, nothing
from edge.gate import PaperGate, TrackRow
from edge.gate.paper import largest_non_outlier

SIZE = (1920, 1080)
STEP_NS = 33_333_333


def found(*places: tuple[float, float]) -> Detections:
    n = len(places)
    if not n:
        return nothing(1)
    return Detections(np.array(places), np.full((n, 2), 8.0), np.full(n, 0.6), np.full(n, 0.4), np.full((n, 1), 0.6))


def run(frames: dict[int, list[tuple[float, float]]], last: int) -> list[TrackRow]:
    gate = PaperGate(SIZE)
    rows = []
    for k in range(last + 1):
        rows += gate.step(k * STEP_NS, found(*frames.get(k, [])))
    return rows


def index(row: TrackRow) -> int:
    return round(row.t_unix_ns / STEP_NS)


def confirmed(rows: list[TrackRow]) -> list[int]:
    return sorted(index(row) for row in rows if row.status == "confirmed")


def interpolated(rows: list[TrackRow]) -> list[int]:
    return sorted(index(row) for row in rows if row.status == "interpolated")


class TestRule1:
    @pytest.mark.parametrize(
        ("apart", "distance", "confirms"),
        [
            (1, 9.9, True),
            (1, 10.0, False),
            (2, 19.9, True),
            (2, 20.0, False),
            (3, 29.9, True),
            (3, 30.0, False),
            (4, 1.0, False),
        ],
    )
    def test_reach(self, apart: int, distance: float, confirms: bool) -> None:
        rows = run({0: [(500, 500)], apart: [(500 + distance, 500)]}, 5)
        assert confirmed(rows) == ([0, apart] if confirms else [])

    def test_alone_is_never_confirmed(self) -> None:
        assert run({3: [(500, 500)]}, 10) == []

    def test_confirmation_waits_three_frames_at_most(self) -> None:
        gate = PaperGate(SIZE)
        late = {}
        for k in range(10):
            for row in gate.step(k * STEP_NS, found((500, 500)) if k % 3 == 0 else found()):
                if row.status == "confirmed":
                    late[index(row)] = k - index(row)
        assert max(late.values()) == 3
        assert set(late) == {0, 3, 6, 9}

    def test_no_detection_is_given_twice(self) -> None:
        rows = run({k: [(500 + 2 * k, 500), (505 + 2 * k, 505)] for k in range(12)}, 12)
        places = [(row.t_unix_ns, row.u_px, row.v_px) for row in rows]
        assert len(places) == len(set(places)) == 24

    def test_two_objects_keep_their_numbers(self) -> None:
        rows = run({k: [(500 + 5 * k, 500), (500 + 5 * k, 600)] for k in range(20)}, 20)
        by_track = {row.track: row.v_px for row in rows}
        assert len(by_track) == 2
        assert all(row.v_px == by_track[row.track] for row in rows)


def gap(frames_apart: int, at: tuple[float, float], moved: float) -> list[TrackRow]:
    """Five frames of flight at 8 px a frame, then nothing, then five more frames."""
    before = {k: [(at[0] + 8 * (k - 4), at[1])] for k in range(5)}
    after = {4 + frames_apart + k: [(at[0] + moved + 8 * k, at[1])] for k in range(5)}
    return run(before | after, 4 + frames_apart + 5)


class TestRule2:
    def test_frames_between_are_interpolated_on_the_line_and_marked(self) -> None:
        rows = gap(10, (800, 500), 80)
        assert interpolated(rows) == list(range(5, 14))
        at = {index(row): row for row in rows}
        assert at[9].u_px == pytest.approx(840)
        assert at[9].sigma_px is None
        assert {row.track for row in rows} == {1}

    @pytest.mark.parametrize(("frames_apart", "bridged"), [(180, True), (181, False)])
    def test_up_to_180_frames_inside_the_image(self, frames_apart: int, bridged: bool) -> None:
        assert bool(interpolated(gap(frames_apart, (800, 500), 300))) == bridged

    @pytest.mark.parametrize(("frames_apart", "bridged"), [(60, True), (61, False)])
    def test_up_to_60_frames_at_its_edge(self, frames_apart: int, bridged: bool) -> None:
        assert bool(interpolated(gap(frames_apart, (800, 5), 300))) == bridged

    @pytest.mark.parametrize(("moved", "bridged"), [(10 * 8 * 2.5 - 1, True), (10 * 8 * 2.5 + 1, False)])
    def test_slower_than_two_and_a_half_times_the_largest_speed(self, moved: float, bridged: bool) -> None:
        assert bool(interpolated(gap(10, (800, 500), moved))) == bridged

    def test_gap_within_rule_1_is_filled_too(self) -> None:
        rows = run({0: [(500, 500)], 3: [(512, 500)], 4: [(516, 500)]}, 4)
        assert interpolated(rows) == [1, 2]


def test_outlier_speeds_do_not_count() -> None:
    assert largest_non_outlier(np.array([2.0] * 20 + [3.0] * 20 + [50.0])) == 3.0
    assert largest_non_outlier(np.zeros(0)) == 0.0
