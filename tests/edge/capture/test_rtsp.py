"""A real RTSP stream over loopback: the sender's time is found to the millisecond, and silence is noticed."""

import time

import numpy as np
import pytest

from edge.capture.frame import Picture
from edge.capture.live import RtspStream, open_rtsp
from edge.capture.reader import Reader
from edge.common.errors import SourceError
from edge.common.utc import UtcMapping
from tools.doubles.rtsp_camera import RtspCamera


def numbered(k: int) -> np.ndarray:
    """A picture that says its number in ten black or white stripes."""
    image = np.full((240, 320, 3), 60, np.uint8)
    for bit in range(10):
        image[100:140, bit * 32 : bit * 32 + 32] = 255 if (k >> bit) & 1 else 0
    return image


def number(image: np.ndarray) -> int:
    return sum(int(image[120, bit * 32 + 16] > 128) << bit for bit in range(10))


def watch(camera: RtspCamera, count: int) -> tuple[list[float], Picture]:
    """Errors in ms of the stamps of count frames against the sender's clock."""
    stream = RtspStream(open_rtsp(camera.url, 2.0), camera.url, colour=False, date=UtcMapping().date)
    errors = []
    for _ in range(count):
        frame = stream.read()
        errors.append((frame.t_unix_ns - camera.taken[number(frame.image)]) / 1e6)
    stream.close()
    return errors, frame


@pytest.mark.parametrize("shift_s", [0.0, -0.06])
def test_sender_time_survives_a_jittery_network(shift_s: float) -> None:
    with RtspCamera(numbered, 25, clock_shift_s=shift_s, delay_s=lambda k: 0.03 * (k % 3 == 1)) as camera:
        errors, frame = watch(camera, 40)
    assert frame.time_source == "sender"
    assert max(map(abs, errors)) < 2.0  # the report's own resolution and the stream clock's 1/90 ms


@pytest.mark.parametrize("shift_s", [3.0, 3599.0, -20.0])
def test_a_sender_whose_clock_arrivals_contradict_is_not_believed(shift_s: float) -> None:
    with RtspCamera(numbered, 25, clock_shift_s=shift_s) as camera:
        errors, frame = watch(camera, 90)
    assert frame.time_source == "arrival"
    # `taken` is by the camera's clock: the stamps are by this box's, and a frame arrives within its bound.
    assert abs(errors[-1] / 1e3 + shift_s) < frame.bound_s


def test_without_reports_arrival_is_used_and_said() -> None:
    # What was buffered while the stream was opened comes late, and nobody knows how late: no bound is claimed for it.
    with RtspCamera(numbered, 25, reports=False) as camera:
        stream = RtspStream(open_rtsp(camera.url, 2.0), camera.url, colour=False, date=UtcMapping().date)
        frames = [stream.read() for _ in range(125)]
        stream.close()
    assert {frame.time_source for frame in frames} == {"arrival"}
    bounded = [frame for frame in frames if frame.bound_s is not None]
    # Two of the five seconds, less what was buffered, which comes at once.
    assert 20 <= len(bounded) <= 75
    for frame in bounded:
        assert abs(frame.t_unix_ns - camera.taken[number(frame.image)]) < frame.bound_s * 1e9


def test_silence_is_noticed_within_its_limit() -> None:
    with RtspCamera(numbered, 25, silent_after=10) as camera:
        stream = RtspStream(open_rtsp(camera.url, 1.0), camera.url, colour=False, date=UtcMapping().date)
        for _ in range(10):
            stream.read()
        last = time.monotonic()
        with pytest.raises(SourceError, match="no more frames"):
            stream.read()
        assert time.monotonic() - last < 2.0


def test_silent_stream_is_opened_again() -> None:
    with RtspCamera(numbered, 25, silent_after=5) as camera:
        reader = Reader(
            "cam1",
            lambda: RtspStream(open_rtsp(camera.url, 0.5), camera.url, colour=False, date=UtcMapping().date),
            live=True,
            lossless=False,
        )
        reader.start()
        deadline = time.monotonic() + 15
        segments = set()
        while len(segments) < 2 and time.monotonic() < deadline:
            if (frame := reader.get(0.5)) is not None:
                segments.add(frame.segment)
        reader.ask_to_stop()
        assert reader.join(3)
    assert len(segments) == 2


def test_refused_port_is_named() -> None:
    with pytest.raises(SourceError, match="nobody answers"):
        open_rtsp("rtsp://127.0.0.1:1/none", 1.0)
