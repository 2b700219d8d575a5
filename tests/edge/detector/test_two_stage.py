"""The two-stage detector finds what moves and what hovers, at its true place, in any order of events."""

from pathlib import Path

import numpy as np
import pytest

from edge.capture.frame import Picture
from edge.common.errors import ModelError
from edge.config import DetectorConfig, GateConfig
from edge.detector.detections import Detections, Detector
from edge.detector.opening import open_detector
from edge.gate import make_gate
from tests.edge.detector.onnx_models import constant_model
from tests.edge.footage import flight, sky

SIZE = (320, 240)
T0 = 1_700_000_000 * 10**9
NOWHERE = np.zeros((0, 3))


def frame(k: int, image: np.ndarray, fps: float = 30.0, segment: int = 0) -> Picture:
    return Picture(T0 + round(k / fps * 1e9), image, "file", 0.0, segment)


def detector(model: Path, mode: str = "two_stage", **config: object) -> Detector:
    return open_detector(DetectorConfig(model=str(model), score_min=0.3, mode=mode, **config), background=False)


def play(one: Detector, dots: list[list[tuple[float, float]]]) -> list[Detections]:
    rng = np.random.default_rng(5)
    return [one.detect(frame(k, sky(SIZE, places, rng)), NOWHERE) for k, places in enumerate(dots)]


def test_moving_dot_is_found_where_it_is(model: Path) -> None:
    way = flight(60)
    found = play(detector(model, scan_period_s=0.0), [[place] for place in way])
    seen = [k for k, one in enumerate(found) if len(one)]
    assert set(seen) >= set(range(10, 60))
    for k in range(10, 60):
        # The hand-made net answers with whole pixels: half a pixel, and the noise's push to a neighbour.
        assert found[k].centre_px[0] == pytest.approx(way[k], abs=1.6)
        assert found[k].sigma_px[0] == pytest.approx(0.5)


def test_hovering_dot_is_found_by_the_scan_alone(model: Path) -> None:
    still = [[(200.0, 100.0)]] * 45
    assert not any(map(len, play(detector(model, scan_period_s=0.0), still)[8:]))
    scanned = play(detector(model, scan_period_s=0.5), still)
    assert [k for k, one in enumerate(scanned) if len(one)] == [0, 15, 30]


def test_expected_place_is_looked_at_though_nothing_moves(model: Path) -> None:
    one = detector(model, scan_period_s=0.0)
    rng = np.random.default_rng(5)
    for k in range(20):
        found = one.detect(frame(k, sky(SIZE, [(200.0, 100.0)], rng)), np.array([[205.0, 96.0, 8.0]]))
    assert found.centre_px == pytest.approx(np.array([[200.0, 100.0]]), abs=1.6)


def test_object_in_two_crops_is_found_once(model: Path) -> None:
    one = detector(model, scan_period_s=0.0)
    rng = np.random.default_rng(5)
    expected = np.array([[190.0, 100.0, 8.0], [212.0, 100.0, 8.0]])
    for k in range(5):
        found = one.detect(frame(k, sky(SIZE, [(200.0, 100.0)], rng)), expected)
    assert len(found) == 1


def test_object_in_the_corner_of_the_image_is_found(model: Path) -> None:
    one = detector(model, scan_period_s=0.0)
    rng = np.random.default_rng(5)
    found = one.detect(frame(0, sky(SIZE, [(3.0, 2.0)], rng)), np.array([[3.0, 2.0, 6.0]]))
    assert found.centre_px == pytest.approx(np.array([[3.0, 2.0]]), abs=1.6)


def test_another_segment_starts_without_a_past(model: Path) -> None:
    one = detector(model, scan_period_s=0.0)
    rng = np.random.default_rng(5)
    for k in range(10):
        one.detect(frame(k, sky(SIZE, [(50.0, 50.0)], rng)), NOWHERE)
    jumped = one.detect(frame(10, sky(SIZE, [(250.0, 180.0)], rng), segment=1), NOWHERE)
    assert len(jumped) == 0


def test_thirty_objects_are_each_looked_at_within_half_a_second_and_followed(model: Path) -> None:
    size, count, frames = (960, 540), 30, 50
    rng = np.random.default_rng(18)
    begin = np.column_stack([np.tile(np.arange(6) * 140.0 + 70, 5), np.repeat(np.arange(5) * 100.0 + 60, 6)])
    speed = np.column_stack([rng.uniform(25, 70, count), rng.uniform(-15, 15, count)])
    one, gate = detector(model, scan_period_s=0.0), make_gate(GateConfig(), size, 0.5)
    grain, last, longest, followed = rng.normal(0, 1.5, (size[1], size[0])), np.full(count, 6), np.zeros(count), set()
    dot = sky((17, 17), [(8.0, 8.0)], rng).astype(float) - 210.0
    for k in range(frames):
        places, image = np.rint(begin + speed * k / 30).astype(int), 210.0 + np.roll(grain, 37 * k)
        for u, v in places:
            image[v - 8 : v + 9, u - 8 : u + 9] += dot
        now = frame(k, np.clip(image, 0, 255).astype(np.uint8))
        found = one.detect(now, gate.expected(now.t_unix_ns))
        near = np.hypot(*(found.centre_px[:, None] - places).T)  # (objects, found)
        seen = near.min(axis=1, initial=99.0) < 4
        longest, last[seen] = np.maximum(longest, k - last), k
        for row in gate.step(now.t_unix_ns, found):
            if row.t_unix_ns == now.t_unix_ns:
                followed.add(int(np.hypot(*(places - (row.u_px, row.v_px)).T).argmin()))
    assert longest.max() <= 15, longest
    assert followed == set(range(count))
    assert one.counters()["detector_late"] == 0


def test_same_frames_give_the_same_bytes(model: Path) -> None:
    dots = [[place] for place in flight(20)]
    first, second = (play(detector(model), dots) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a.centre_px.tobytes() == b.centre_px.tobytes()
        assert a.score.tobytes() == b.score.tobytes()


def test_background_scan_finds_the_same_and_ends(model: Path, until) -> None:
    one = open_detector(
        DetectorConfig(model=str(model), score_min=0.3, scan_period_s=0.1, mode="two_stage"), background=True
    )
    rng = np.random.default_rng(5)
    image = sky(SIZE, [(200.0, 100.0)], rng)
    one.detect(frame(0, image), NOWHERE)
    assert until(lambda: one.counters()["detector_scans"] == 1)
    assert len(one.detect(frame(1, image), NOWHERE)) == 1
    one.close()


def test_full_frame_mode_of_the_shipped_format(model: Path) -> None:
    found = play(detector(model, mode="full_frame"), [[place] for place in flight(10)])
    assert all(len(one) == 1 for one in found)


def test_model_that_breaks_its_promise_is_named(tmp_path: Path) -> None:
    outputs = {"boxes": np.zeros((1, 4, 5), np.float32)}
    path = constant_model(tmp_path / "m.onnx", outputs, notes={"skyfix": "{}"})
    with pytest.raises(ModelError, match=r"m\.onnx"):
        detector(path)
    path = constant_model(tmp_path / "n.onnx", outputs, notes={"skyfix": "no json"})
    with pytest.raises(ModelError, match="not JSON"):
        detector(path)
