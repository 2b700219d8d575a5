"""A frame in, messages out: rays belong to their pixels, silence is said, bad input is left out and counted."""

from typing import Any

import numpy as np
import pytest

from edge.capture.frame import Picture
from edge.common.arrays import Array
from edge.common.errors import ConfigError
from edge.config import GateConfig
from edge.detector.detections import Detections, nothing
from edge.lens import LensModel, ray_to_pixel
from edge.messages import Tracks, decode, encode
from edge.pipeline import CameraFacts, Pipeline, SideBySide, total_bound_s

SIZE = (640, 480)
T0 = 1_700_000_000 * 10**9
LENS = LensModel("radtan", (500.0, 500.0, 319.5, 239.5), (-0.2, 0.05, 0.001, -0.001), SIZE)


class Scripted:
    """A detector that finds what a test put into the frame's first pixels: nothing, or a dot that flies."""

    class_names = ("drone", "bird")
    colour = False
    remembers = False
    track_score = 0.45

    def __init__(self, places: list[tuple[float, float] | None]) -> None:
        self.places = places

    def detect(self, frame: Picture, expected_px: Array) -> Detections:
        place = self.places[int(frame.image[0, 0])]
        if place is None:
            return nothing(2)
        one = np.ones((1, 2))
        return Detections(np.array([place]), 8 * one, np.array([0.9]), np.array([0.3]), np.array([[0.8, 0.2]]))

    def counters(self) -> dict[str, float]:
        return {}

    def close(self) -> None:
        pass


def facts(profile: Any = "tracks") -> CameraFacts:
    return CameraFacts("cam1", LENS, 0.02, GateConfig(profile=profile), epoch=7)


def frame(k: int, t_ns: int | None = None, **more: Any) -> Picture:
    image = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    image[0, 0] = k
    return Picture(T0 + round(k / 30 * 1e9) if t_ns is None else t_ns, image, more.pop("source", "file"), 0.001, **more)


def flying(count: int) -> list[tuple[float, float] | None]:
    return [(100.0 + 5 * k, 200.0 + k) for k in range(count)]


def run(pipeline: Pipeline, frames: list[Picture]) -> list[Tracks]:
    messages = [message for one in frames for message in pipeline.step(one)]
    # What is sent must be what the contract allows.
    return [decode(encode(message), Tracks, where="test") for message in messages]


def test_raw_pixel_and_ray_belong_together() -> None:
    messages = run(Pipeline(facts(), Scripted(flying(60)), lambda: None), [frame(k) for k in range(60)])
    detections = [detection for message in messages for detection in message.detections]
    assert len(detections) > 50
    rays = np.array([(detection.ray_x, detection.ray_y) for detection in detections])
    pixels = np.array([(detection.u_px, detection.v_px) for detection in detections])
    assert ray_to_pixel(LENS, rays) == pytest.approx(pixels, abs=1e-6)
    first = detections[0]
    assert (first.classes, first.sigma_px, first.status) == ({"drone": 0.8, "bird": 0.2}, 0.3, "confirmed")


def test_head_of_a_message() -> None:
    messages = run(Pipeline(facts(), Scripted(flying(60)), lambda: 0.5), [frame(k) for k in range(60)])
    assert [message.seq for message in messages] == list(range(1, len(messages) + 1))
    assert {(message.epoch, message.size_px, message.readout_s, message.clock_bound_s) for message in messages} == {
        (7, SIZE, 0.02, 0.001)
    }


def test_nothing_seen_is_said_twice_a_second() -> None:
    messages = run(Pipeline(facts(), Scripted([None] * 256), lambda: None), [frame(k) for k in range(91)])
    assert [round((message.t_unix_ns - T0) / 1e9, 1) for message in messages] == [0, 0.5, 1, 1.5, 2, 2.5, 3]
    assert not any(message.detections for message in messages)


def test_bound_adds_the_clock_only_where_the_box_stamped() -> None:
    assert total_bound_s(frame(0, source="sensor"), 0.002) == pytest.approx(0.003)
    assert total_bound_s(frame(0, source="sensor"), None) is None
    assert total_bound_s(frame(0, source="file"), None) == 0.001
    assert total_bound_s(Picture(T0, frame(0).image, "file", None), 0.002) is None


def test_lens_of_another_resolution_is_refused() -> None:
    pipeline = Pipeline(facts(), Scripted([None]), lambda: None)
    with pytest.raises(ConfigError, match=r"camera cam1.*640 x 480.*320 x 240"):
        pipeline.step(Picture(T0, np.zeros((240, 320), np.uint8), "file"))


def test_stamps_that_come_twice_are_said_with_their_number() -> None:
    pipeline = Pipeline(facts(), Scripted([None] * 256), lambda: None)
    assert pipeline.order is None
    run(pipeline, [frame(k - k % 2) for k in range(80)])
    assert pipeline.order is not None
    assert pipeline.order.what.startswith("40 of 80 frames have no later time")
    steady = Pipeline(facts(), Scripted([None] * 256), lambda: None)
    run(steady, [*map(frame, range(100)), frame(99)])
    assert steady.order is None


def test_time_that_stands_or_goes_back_is_left_out_and_counted() -> None:
    pipeline = Pipeline(facts(), Scripted(flying(90)), lambda: None)
    frames = [frame(k) for k in range(60)]
    messages = run(pipeline, [*frames[:30], frames[29], frames[25], *frames[30:]])
    assert pipeline.counters()["frames_backwards"] == 2
    times = [message.t_unix_ns for message in messages for _ in message.detections]
    assert len(times) == len(set(times)) == 60


def test_clock_set_back_begins_new_tracks() -> None:
    pipeline = Pipeline(facts(), Scripted(flying(60) + flying(60)), lambda: None)
    frames = [frame(k) for k in range(60)] + [frame(60 + k, T0 - 10**12 + round(k / 30 * 1e9)) for k in range(60)]
    tracks = {
        detection.track: message.t_unix_ns for message in run(pipeline, frames) for detection in message.detections
    }
    assert pipeline.counters()["clock_stepped"] == 1
    assert len(tracks) == 2


def test_pixel_without_a_ray_is_left_out_and_counted() -> None:
    # Beyond the fold of this strong lens a pixel has no ray.
    lens = LensModel("radtan", (300.0, 300.0, 319.5, 239.5), (-0.45, 0.0, 0.0, 0.0), SIZE)
    pipeline = Pipeline(
        CameraFacts("cam1", lens, 0.0, GateConfig(), 1),
        Scripted([(2.0 + 5 * k, 2.0 + k) for k in range(60)]),
        lambda: 0.0,
    )
    messages = run(pipeline, [frame(k) for k in range(60)])
    assert pipeline.counters()["rows_without_ray"] > 0
    assert all(np.isfinite(one.ray_x) for message in messages for one in message.detections)


def test_paper_profile_gives_interpolated_rows_late() -> None:
    places = flying(60)
    places[20:26] = [None] * 6
    messages = run(Pipeline(facts("paper"), Scripted(places), lambda: None), [frame(k) for k in range(60)])
    between = [m for m in messages for d in m.detections if d.status == "interpolated"]
    assert [round((message.t_unix_ns - T0) * 30 / 1e9) for message in between] == list(range(20, 26))


def test_side_by_side_gives_the_same_in_order() -> None:
    frames = [frame(k) for k in range(60)]
    alone = run(Pipeline(facts(), Scripted(flying(60)), lambda: None), frames)
    pipeline = SideBySide(Pipeline(facts(), Scripted(flying(60)), lambda: None), workers=3)
    together = [message for one in frames for message in pipeline.step(one)] + pipeline.flush()
    pipeline.close()
    assert [encode(message) for message in together] == [encode(message) for message in alone]
