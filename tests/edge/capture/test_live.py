"""Live sources: whose clock stamped a frame, and whether it is to be believed."""

import cv2
import numpy as np
import pytest

from edge.capture.frame import Picture
from edge.capture.live import RtspStream
from edge.capture.stamps import ARRIVAL_BOUND_S
from edge.common.utc import UtcMapping
from tests.edge.capture.sources import MS, T0, FakeCapture, undoubted


class TestRtsp:
    def frames(self, opened_us: float, delays_ms: list[float]) -> list[Picture]:
        fps = 25.0
        props = [
            {
                cv2.CAP_PROP_POS_MSEC: k * 40.0 + 7.0,  # the exact position: 7 ms off the frame grid
                cv2.CAP_PROP_PTS: float(round((k * 40.0 + 7.0) * fps / 1e3)),
                cv2.CAP_PROP_FPS: fps,
                cv2.CAP_PROP_STREAM_OPEN_TIME_USEC: opened_us,
            }
            for k in range(len(delays_ms))
        ]
        arrivals = iter([T0 + round((k * 40 + delay) * MS) for k, delay in enumerate(delays_ms)])
        source = RtspStream(
            FakeCapture(props), "rtsp://box", colour=False, date=undoubted, monotonic_ns=lambda: next(arrivals)
        )
        return [source.read() for _ in delays_ms]

    def test_sender_time_is_used_where_there_is_one(self) -> None:
        frames = self.frames(T0 / 1e3, [50.0] * 10)
        assert {frame.time_source for frame in frames} == {"sender"}
        assert np.diff([frame.t_unix_ns for frame in frames]) == pytest.approx(40 * MS, abs=1000)

    @pytest.mark.parametrize("opened_us", [0.0, 12345.0])
    def test_without_one_the_least_delayed_arrival_counts(self, opened_us: float) -> None:
        frames = self.frames(opened_us, [50, 30, 120, 90, 30, 31])
        assert {frame.time_source for frame in frames} == {"arrival"}
        assert [frame.t_unix_ns - T0 for frame in frames[1:]] == [round((k * 40 + 30) * MS) for k in range(1, 6)]

    def test_a_step_of_utc_does_not_stay_among_the_arrivals(self) -> None:
        """The least delay of 30 s is by the monotonic clock: a step shows in the next frame, and in no later one."""
        clock = StepClock()
        mapping = UtcMapping(lambda: clock.monotonic_ns, lambda: clock.monotonic_ns + clock.offset_ns)
        props = [{cv2.CAP_PROP_POS_MSEC: k * 40.0, cv2.CAP_PROP_FPS: 25.0} for k in range(100)]

        def arrival_ns() -> int:
            clock.monotonic_ns += 40 * MS
            clock.offset_ns += 500 * MS if clock.monotonic_ns == StepClock.STEP_AT_NS else 0
            return clock.monotonic_ns

        source = RtspStream(FakeCapture(props), "rtsp://box", colour=False, date=mapping.date, monotonic_ns=arrival_ns)
        frames = [source.read() for _ in props]
        gaps_ms = np.diff([frame.t_unix_ns for frame in frames]) / MS
        assert np.count_nonzero(gaps_ms != 40.0) == 1
        assert gaps_ms.sum() == pytest.approx(99 * 40 + 500)
        assert {frame.bound_s for frame in frames} <= {None, ARRIVAL_BOUND_S}  # it is known to the instant


class StepClock:
    """Two clocks that are moved by hand."""

    STEP_AT_NS = 10**12 + 70 * 40 * MS

    def __init__(self) -> None:
        self.monotonic_ns, self.offset_ns = 10**12, T0


class Hanging(FakeCapture):
    """A camera whose encoder hands out one picture from its fiftieth on."""

    def retrieve(self) -> tuple[bool, np.ndarray]:
        rng = np.random.default_rng(min(self.at, 50))
        return True, rng.integers(0, 255, (24, 32, 3), np.uint8)


def test_a_picture_that_does_not_change_by_a_pixel_is_told() -> None:
    clock = iter(range(0, 10**12, 40 * MS))
    frames = [{cv2.CAP_PROP_POS_MSEC: 40.0 * k} for k in range(200)]
    stream = RtspStream(
        Hanging(frames), "rtsp://cam", colour=False, date=undoubted, monotonic_ns=lambda: next(clock) + 10**12
    )
    told = []
    for _ in range(200):
        stream.read()
        told.append([remark.what for remark in stream.remarks if "changed" in remark.what])
    assert not any(told[:149])
    assert told[-1] == ["its picture has not changed by a pixel for 6 s"]
