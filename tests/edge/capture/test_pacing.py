"""A recording played at the pace of its stamps drops what is late, and counts it."""

from pathlib import Path

from edge.capture.pacing import Realtime
from edge.capture.video import VideoFile
from tests.edge.capture.sources import MS, T0


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
