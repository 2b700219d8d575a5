"""Sources give every frame its honest time, and every failure its name."""

import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.capture import kind_of, open_source
from edge.capture.files import ImageFolder, VideoFile
from edge.capture.frame import Picture, middle_of_exposure
from edge.capture.live import RtspStream, V4l2Camera
from edge.capture.pacing import Realtime
from edge.capture.reader import Reader
from edge.capture.stamps import ARRIVAL_BOUND_S, LeastDelay, StreamDrift
from edge.common.errors import ConfigError, SourceError
from edge.config import CameraConfig, LensConfig, SourceConfig
from tests.edge.footage import sky, write_video

T0 = 1_700_000_000 * 10**9
MS = 10**6
SIZE = (160, 120)
LENS = LensConfig(model="radtan", intrinsics=(100.0, 100.0, 80.0, 60.0), distortion=(0.0, 0.0, 0.0, 0.0), size_px=SIZE)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(3)
    images = [sky(SIZE, [(20.0 + 3 * k, 60.0)], rng) for k in range(20)]
    return write_video(tmp_path_factory.mktemp("video") / "a.mp4", images, fps=25)


def frames_of(source: Any) -> list[Picture]:
    return list(iter(source.read, None))


def camera(path: str, **source: Any) -> CameraConfig:
    return CameraConfig(id="cam1", lens=LENS, source=SourceConfig(path=path, **source))


class TestFiles:
    def test_every_frame_comes_at_its_own_time(self, video: Path) -> None:
        frames = frames_of(VideoFile(str(video), t0_unix_ns=T0, bound_s=0.002))
        assert [frame.t_unix_ns - T0 for frame in frames] == [round(k * 40 * MS) for k in range(20)]
        assert {(frame.time_source, frame.bound_s, frame.size_px) for frame in frames} == {("file", 0.002, SIZE)}
        assert frames[0].image.ndim == 2

    def test_loop_goes_on_in_time_as_another_segment(self, video: Path) -> None:
        source = VideoFile(str(video), t0_unix_ns=T0, bound_s=0.0, loop=True)
        frames = [source.read() for _ in range(45)]
        assert [frame.t_unix_ns - T0 for frame in frames] == [k * 40 * MS for k in range(45)]
        assert [frames[k].segment for k in (0, 19, 20, 44)] == [0, 0, 1, 2]

    def test_colour_where_it_is_needed(self, video: Path) -> None:
        assert VideoFile(str(video), t0_unix_ns=T0, bound_s=0.0, colour=True).read().image.shape == (120, 160, 3)

    @pytest.mark.parametrize(
        ("content", "said"), [(None, "no such file"), (b"", "no video"), (b"not a video at all" * 50, "no video")]
    )
    def test_what_is_no_video_is_named(self, tmp_path: Path, content: bytes | None, said: str) -> None:
        file = tmp_path / "bad.mp4"
        if content is not None:
            file.write_bytes(content)
        with pytest.raises(SourceError, match=rf"bad\.mp4.*{said}"):
            VideoFile(str(file), t0_unix_ns=T0, bound_s=0.0)

    def test_a_file_cut_off_ends_without_an_error(self, tmp_path: Path) -> None:
        rng = np.random.default_rng(4)
        whole = write_video(tmp_path / "whole.avi", [sky(SIZE, [(5.0 * k, 50)], rng) for k in range(20)])
        (tmp_path / "cut.avi").write_bytes(whole.read_bytes()[: whole.stat().st_size * 4 // 5])
        assert 0 < len(frames_of(VideoFile(str(tmp_path / "cut.avi"), t0_unix_ns=T0, bound_s=0.0))) < 20

    def test_folder_in_order_of_names_with_stamps_from_names(self, tmp_path: Path) -> None:
        for k in (2, 0, 1):
            cv2.imwrite(str(tmp_path / f"cam_{T0 + k * 50 * MS}.png"), np.full((12, 16), k, np.uint8))
        (tmp_path / "notes.txt").write_text("not an image")
        frames = frames_of(ImageFolder(str(tmp_path), t0_unix_ns=5, bound_s=0.0, fps=30))
        assert [frame.t_unix_ns for frame in frames] == [T0, T0 + 50 * MS, T0 + 100 * MS]
        assert [int(frame.image[0, 0]) for frame in frames] == [0, 1, 2]

    def test_folder_without_stamps_counts(self, tmp_path: Path) -> None:
        for k in range(3):
            cv2.imwrite(str(tmp_path / f"{k:03}.png"), np.zeros((12, 16), np.uint8))
        frames = frames_of(ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20))
        assert [frame.t_unix_ns - T0 for frame in frames] == [0, 50 * MS, 100 * MS]

    def test_folder_that_grows(self, tmp_path: Path, until) -> None:
        stop, seen = threading.Event(), []
        source = ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20, follow=True, stop=stop)
        thread = threading.Thread(target=lambda: seen.extend(iter(source.read, None)))
        thread.start()
        for k in range(3):
            cv2.imwrite(str(tmp_path / f"{k:03}.png"), np.full((12, 16), k, np.uint8))
            assert until(lambda k=k: len(seen) >= k)  # the newest may still be written to
        source.close()
        thread.join(2)
        assert [int(frame.image[0, 0]) for frame in seen] == [0, 1, 2]

    def test_broken_image_is_named(self, tmp_path: Path) -> None:
        (tmp_path / "a.png").write_bytes(b"no")
        with pytest.raises(SourceError, match=r"a\.png.*no image"):
            ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20).read()

    def test_kinds_are_told_apart(self, tmp_path: Path) -> None:
        kinds = {path: kind_of(camera(path)) for path in ("rtsp://box/1", "/dev/video0", "a.mp4", str(tmp_path))}
        assert list(kinds.values()) == ["rtsp", "v4l2", "file", "folder"]
        with pytest.raises(ConfigError, match="no known kind"):
            kind_of(camera("http://box/1"))

    def test_undated_recording_has_no_bound(self, video: Path) -> None:
        source = open_source(camera(str(video)), colour=False, stop=threading.Event(), unix_ns=int)
        assert source.read().bound_s is None


class Clock:
    """UTC that only moves when somebody waits."""

    def __init__(self, now_ns: int) -> None:
        self.now_ns = now_ns

    def wait(self, seconds: float) -> bool:
        self.now_ns += round(seconds * 1e9)
        return False


class TestRealtime:
    def play(self, video: Path, clock: Clock, start: int | None, slow_ns: int = 0) -> tuple[Realtime, list[int]]:
        file = VideoFile(str(video), t0_unix_ns=T0, bound_s=0.0)
        source = Realtime(file, clock, start, lambda: clock.now_ns)  # type: ignore[arg-type]
        shown = []
        while source.read() is not None:
            shown.append(clock.now_ns)
            clock.now_ns += slow_ns
        return source, shown

    def test_frames_are_shown_when_their_stamps_say(self, video: Path) -> None:
        start = T0 + 10**9
        source, shown = self.play(video, Clock(T0 + 300 * MS), start)
        assert shown == [start + k * 40 * MS for k in range(20)]
        assert source.skipped == 0

    def test_late_start_passes_over_what_is_gone(self, video: Path) -> None:
        source, shown = self.play(video, Clock(T0 + 400 * MS), T0)
        # 100 ms are caught up without loss: frames 8 to 10 at once, then in time.
        assert source.skipped == 8
        assert len(shown) == 12

    def test_slow_reader_loses_frames_and_they_are_counted(self, video: Path) -> None:
        source, shown = self.play(video, Clock(T0), T0, slow_ns=100 * MS)
        assert source.skipped + len(shown) == 20
        assert source.skipped > 5


class FakeCapture:
    """Stands in for a driver: frames with the stamps a test wants, then silence."""

    def __init__(self, frames: list[dict[int, float]]) -> None:
        self.frames, self.at, self.released = frames, -1, False

    def isOpened(self) -> bool:
        return True

    def grab(self) -> bool:
        self.at += 1
        return self.at < len(self.frames)

    def retrieve(self) -> tuple[bool, Any]:
        return True, np.zeros((120, 160, 3), np.uint8)

    def get(self, prop: int) -> float:
        return self.frames[self.at].get(prop, 0.0)

    def set(self, prop: int, value: float) -> bool:
        return True

    def release(self) -> None:
        self.released = True


class TestV4l2:
    OFFSET = T0 - 5000 * 10**9  # UTC minus monotonic

    def read(self, stamp_ms: float, arrival_ns: int, **options: Any) -> Picture:
        source = V4l2Camera(
            FakeCapture([{cv2.CAP_PROP_POS_MSEC: stamp_ms}]),
            "/dev/video0",
            colour=False,
            unix_ns=lambda monotonic_ns: monotonic_ns + self.OFFSET,
            monotonic_ns=lambda: arrival_ns,
            **options,
        )
        return source.read()

    def test_driver_stamp_becomes_utc(self) -> None:
        frame = self.read(5000_123.456, 5000_160 * MS)
        assert frame.t_unix_ns == T0 + 123_456_000
        assert frame.time_source == "sensor"

    @pytest.mark.parametrize(
        ("stamp_of", "shift_ms"), [("middle", 0), ("exposure_start", 4), ("exposure_end", -4), ("frame_end", -24)]
    )
    def test_stamps_of_other_instants_are_moved_to_the_middle(self, stamp_of: Any, shift_ms: int) -> None:
        frame = self.read(5000_100.0, 5000_160 * MS, stamp_of=stamp_of, exposure_s=0.008, readout_s=0.02)
        assert frame.t_unix_ns == T0 + (100 + shift_ms) * MS
        assert middle_of_exposure(0, stamp_of, 0.008, 0.02) == shift_ms * MS

    @pytest.mark.parametrize("stamp_ms", [0.0, 6000_000.0, 1_700_000_000_000.0])
    def test_without_a_believable_stamp_arrival_counts_and_says_so(self, stamp_ms: float) -> None:
        frame = self.read(stamp_ms, 5000_160 * MS)
        assert (frame.t_unix_ns, frame.time_source, frame.bound_s) == (T0 + 160 * MS, "arrival", ARRIVAL_BOUND_S)

    def test_dead_camera_says_so(self) -> None:
        source = V4l2Camera(FakeCapture([]), "/dev/video7", colour=False, unix_ns=int)
        with pytest.raises(SourceError, match=r"/dev/video7.*no more frames"):
            source.read()


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
        source = RtspStream(FakeCapture(props), "rtsp://box", colour=False, now_unix_ns=lambda: next(arrivals))
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


@given(st.lists(st.floats(0, 500), min_size=1, max_size=60))
def test_least_delay_is_never_later_than_arrival_nor_earlier_than_the_least(delays_ms: list[float]) -> None:
    mapping = LeastDelay()
    for k, delay in enumerate(delays_ms):
        stream_ns, arrival_ns = k * 33 * MS, T0 + k * 33 * MS + round(delay * MS)
        t = mapping.unix_ns(stream_ns, arrival_ns)
        assert t <= arrival_ns
        assert t - stream_ns - T0 == round(min(delays_ms[: k + 1]) * MS)


def test_drift_of_a_stream_is_taken_off() -> None:
    # A stream clock 50 ppm fast for ten minutes: 30 ms; delays of 20 ms and more, now and then the least.
    least, drift, worst_ms = LeastDelay(), StreamDrift(), 0.0
    rng = np.random.default_rng(7)
    for k in range(6000):
        true_ns = T0 + k * 100 * MS
        stream_ns = round(k * 100 * MS * (1 + 50e-6))
        arrived_ns = least.unix_ns(stream_ns, true_ns + round(rng.exponential(10) * MS) + 20 * MS)
        sent_ns = T0 + stream_ns
        worst_ms = max(worst_ms, abs(sent_ns + drift.drift_ns(stream_ns, arrived_ns, sent_ns) - true_ns) / MS)
    # 1.5 ms before the reference is found, and as much again by which the least of 30 s lags behind.
    assert worst_ms < 4.0


def test_slow_minute_of_the_network_is_not_taken_for_drift() -> None:
    least, drift, worst_ms = LeastDelay(), StreamDrift(), 0.0
    for k in range(3000):
        stream_ns = k * 100 * MS
        slow_ns = 5000 * MS if 1000 <= k < 1900 else 0  # 90 s of 5 s delay: the least of 30 s is 5 s for 60 s
        arrived_ns = least.unix_ns(stream_ns, T0 + stream_ns + 20 * MS + slow_ns)
        worst_ms = max(worst_ms, abs(drift.drift_ns(stream_ns, arrived_ns, T0 + stream_ns)) / MS)
    assert worst_ms == pytest.approx(6.0, abs=0.1)  # 100 ppm of 60 s


class Scripted:
    """A source that follows a script of frames and errors."""

    live = True
    skipped = 0

    def __init__(self, script: list[Any]) -> None:
        self.script = list(script)

    def read(self) -> Picture | None:
        if not self.script:
            return None
        item = self.script.pop(0)
        if isinstance(item, Exception):
            raise item
        return item

    def close(self) -> None:
        pass


def frame(k: int) -> Picture:
    return Picture(T0 + k, np.zeros((4, 4), np.uint8), "file")


DEAD = SourceError("dead", where="cam", action="look")


class TestReader:
    def test_recording_loses_nothing(self) -> None:
        reader = Reader("r", lambda: Scripted([frame(k) for k in range(50)]), live=False, lossless=True)
        reader.start()
        got = []
        while not reader.finished:
            if (one := reader.get(1.0)) is not None:
                got.append(one.t_unix_ns - T0)
        assert got == list(range(50))
        assert reader.state.dropped == 0

    def test_live_keeps_the_newest_and_counts_the_rest(self, until) -> None:
        reader = Reader("r", lambda: Scripted([frame(k) for k in range(50)]), live=False, lossless=False)
        reader.start()
        assert until(lambda: reader.state.ended)
        assert [reader.get(0).t_unix_ns - T0 for _ in range(2)] == [48, 49]
        assert (reader.state.frames, reader.state.dropped) == (50, 48)

    def test_dead_source_is_opened_again_as_another_segment(self) -> None:
        scripts = iter([[frame(0), DEAD], [frame(1)]])
        reader = Reader("r", lambda: Scripted(next(scripts, [])), live=True, lossless=False)
        reader.start()
        first, second = reader.get(5.0), reader.get(5.0)
        assert (first.segment, second.segment) == (0, 1)
        assert reader.state.reopened >= 1
        reader.stop()
        assert reader.join(2.0)

    def test_recording_that_does_not_open_ends_with_its_error(self) -> None:
        def fail() -> Scripted:
            raise DEAD

        reader = Reader("r", fail, live=False, lossless=True)
        reader.start()
        assert reader.get(2.0) is None
        assert reader.finished
        assert reader.state.error is DEAD
