"""The two-stage detector finds what moves and what hovers, at its true place, in any order of events."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.capture.frame import Picture
from edge.common.errors import ModelError
from edge.config import DetectorConfig
from edge.detector.crops import SIDE_PX, choose, cut, in_frame
from edge.detector.detections import Detections, Detector
from edge.detector.history import History
from edge.detector.motion import MotionDetector
from edge.detector.opening import open_detector
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


def test_past_is_found_by_time_not_by_index() -> None:
    history = History((0.1, 0.2))
    for k, t_ms in enumerate([0, 20, 45, 110, 140, 190, 230]):
        history.push(Picture(T0 + t_ms * 10**6, np.full((2, 2), k, np.uint8), "file"))
    assert [int(image[0, 0]) for image in history.past()] == [4, 1]  # 140 for 130, 20 for 30


def test_gap_and_step_back_forget_the_past() -> None:
    history = History((0.1, 0.2))
    image = np.zeros((2, 2), np.uint8)
    assert [history.push(Picture(T0 + t, image, "file")) for t in (0, 10**8, 3 * 10**9, 2 * 10**9)] == [
        False,
        False,
        True,
        True,
    ]


def test_motion_learns_what_always_moves_and_still_sees_what_is_new() -> None:
    rng = np.random.default_rng(6)
    motion = MotionDetector()
    images = []
    for k in range(200):
        image = sky(SIZE, [(40 + 60 * (k - 180) / 30, 60.0)] if k >= 180 else [], rng)
        image[150:] = rng.integers(0, 255, (90, 320), np.uint8)  # a wood in a gale
        images.append(image)
        if k >= 6:
            blobs = motion.propose(image, [images[-4], images[-7]], 1 / 30)
    assert len(blobs.strength)
    assert blobs.centre_px[0] == pytest.approx((40 + 60 * 19 / 30, 60.0), abs=4)
    assert np.all(blobs.centre_px[:, 1] < 150) or np.mean(blobs.centre_px[:, 1] < 150) > 0.5


def test_everything_moving_proposes_nothing() -> None:
    rng = np.random.default_rng(6)
    motion = MotionDetector()
    still = sky(SIZE, [], rng)
    motion.propose(still, [still, still], 0.03)
    blobs = motion.propose(rng.integers(0, 255, still.shape, np.uint8), [still, still], 0.03)
    assert blobs.share > 0.5
    assert not len(blobs.strength)


@given(
    u=st.floats(-20, 1940),
    v=st.floats(-20, 1100),
    extent=st.floats(1, 300),
    size=st.tuples(st.integers(64, 1920), st.integers(64, 1080)),
)
def test_crops_lie_in_the_frame_and_hold_their_region(u: float, v: float, extent: float, size: tuple[int, int]) -> None:
    (crop,) = choose(np.array([[u, v, extent]]), size, 4)
    assert crop.left >= 0
    assert crop.top >= 0
    for at, low, length in ((u, crop.left, size[0]), (v, crop.top, size[1])):
        if crop.side_px <= length:
            assert low + crop.side_px <= length
        if 0 <= at <= length - 1:
            assert low <= at <= low + crop.side_px


def test_crop_coordinates_invert_reduction() -> None:
    image = np.zeros((512, 512), np.uint8)
    image[200:204, 300:304] = 255  # centre at 301.5, 201.5
    (crop,) = choose(np.array([[301.5, 201.5, 100.0]]), (512, 512), 1)
    assert crop.reduction == 4
    piece = cut([image], [crop])[0, :, :, 0].astype(float)
    assert piece.shape == (SIDE_PX, SIDE_PX)
    v, u = np.indices(piece.shape)
    centre = np.array([[(piece * u).sum(), (piece * v).sum()]]) / piece.sum()
    one = np.ones(1)
    found = Detections(centre, np.full((1, 2), 1.0), one, one, np.ones((1, 1)))
    back = in_frame(found, [crop], np.zeros(1, np.intp), (512, 512))
    assert back.centre_px[0] == pytest.approx((301.5, 201.5), abs=1e-6)
    assert back.size_px[0] == pytest.approx((4.0, 4.0))
