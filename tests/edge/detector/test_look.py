"""The network on whole pictures: small ones are seen twice, and every object is told once, where it is."""

from pathlib import Path

import numpy as np
import pytest

from edge.capture.frame import Picture
from edge.config import DetectorConfig
from edge.detector.detections import Detections
from edge.detector.look import _small_and_whole, look
from edge.detector.magnify import enlarged, reduced
from edge.detector.opening import open_detector
from edge.detector.session import open_model
from edge.detector.skyfix import StackNet
from tests.edge.footage import sky

ONE = (np.ones(1), np.ones(1), np.ones((1, 1)))
THREE = (np.ones(3), np.ones(3), np.ones((3, 1)))


class Watched(StackNet):
    """A net that keeps the sizes of the pictures it was shown."""

    def run(self, stack: np.ndarray, score_min: float) -> list[Detections]:
        self.shown = [*getattr(self, "shown", []), stack.shape[1:3]]
        return super().run(stack, score_min)


@pytest.mark.parametrize(("size", "looks"), [((320, 256), 2), ((640, 512), 1)])
def test_a_reduced_picture_is_also_looked_at_enlarged(model: Path, size: tuple[int, int], looks: int) -> None:
    net = Watched(open_model(model))
    net.shown = []
    found = look(net, [sky(size, [(200.0, 100.0)], np.random.default_rng(5))] * 3, 0.3)
    assert len(net.shown) == looks
    assert len(found) == 1, "one object, however often it was seen"
    assert found.centre_px == pytest.approx(np.array([[200.0, 100.0]]), abs=1.6)


def test_what_is_found_enlarged_is_where_it_was() -> None:
    image = np.zeros((64, 64), np.uint8)
    image[20:22, 30:32] = 255  # centre at 30.5, 20.5
    larger = enlarged(image).astype(float)
    v, u = np.indices(larger.shape)
    centre = np.array([[(larger * u).sum(), (larger * v).sum()]]) / larger.sum()
    size = np.array([[4.0, 4.0]])
    back = reduced(Detections(centre, size, np.ones(1), np.array([0.5]), np.ones((1, 1))))
    assert back.centre_px[0] == pytest.approx((30.5, 20.5), abs=0.02)  # what is cut off below black is lost
    assert back.size_px[0] == pytest.approx((2.0, 2.0))
    assert back.sigma_px[0] == pytest.approx(0.25)


def test_what_is_no_part_of_the_picture_is_not_found_and_a_tiny_picture_is_looked_at(model: Path) -> None:
    net = StackNet(open_model(model))
    edge = sky((321, 241), [(320.0, 100.0)], np.random.default_rng(5))  # repeated into the columns that fill it up
    assert np.all(look(net, [edge] * 3, 0.1).centre_px <= (320.5, 240.5))
    assert len(look(net, [np.full((3, 17), 200, np.uint8)] * 3, 0.3)) == 0


def test_a_large_object_is_not_told_in_parts() -> None:
    whole = Detections(np.array([[50.0, 50.0]]), np.array([[40.0, 14.0]]), *ONE)
    parts = Detections(
        np.array([[40.0, 52.0], [80.0, 50.0], [50.0, 50.0]]), np.array([[8.0, 6.0], [8.0, 6.0], [40.0, 14.0]]), *THREE
    )
    kept = _small_and_whole(parts, whole)
    assert kept.centre_px.tolist() == [[80.0, 50.0]]


@pytest.mark.parametrize(("size", "by"), [((320, 240), "frames"), ((640, 480), "crops")])
def test_left_to_itself_the_detector_goes_by_the_size_of_the_pictures(
    model: Path, size: tuple[int, int], by: str
) -> None:
    one = open_detector(DetectorConfig(model=str(model)), background=False)
    assert one.counters() == {}
    one.detect(
        Picture(1_700_000_000 * 10**9, sky(size, [], np.random.default_rng(5)), "file", 0.0, 0), np.zeros((0, 3))
    )
    assert ("detector_crops" in one.counters()) == (by == "crops")
    one.close()
