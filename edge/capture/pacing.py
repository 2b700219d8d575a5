"""Playing a recording as if it were happening: each frame at the instant its stamp asks for.

The pace comes from the stamps alone, against a wall-clock instant that several boxes can share. What cannot be shown in
time is passed over and counted, as a live camera would have lost it; it is never shown late, for then the boxes of one
site would drift apart.
"""

import threading
import time
from collections.abc import Callable
from typing import Final

from edge.capture.frame import Picture, Remark
from edge.capture.video import VideoFile

LATE_NS: Final = 100_000_000  # ns: three frames at 30 Hz; less is caught up without loss


class Realtime:
    """A video file played at the pace of its stamps. start_at_unix_ns: when to play the first frame; None for now."""

    live = False

    def __init__(
        self,
        video: VideoFile,
        stop: threading.Event,
        start_at_unix_ns: int | None = None,
        now_unix_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._video = video
        self._stop = stop
        self._start_at = start_at_unix_ns
        self._now = now_unix_ns
        self._wall_minus_stamp: int | None = None
        self.skipped = 0

    def read(self) -> Picture | None:
        """The next frame that is in time, when its time has come; None at the end or when told to stop."""
        while (t_unix_ns := self._video.grab()) is not None:
            wait_ns = self._due(t_unix_ns) - self._now()
            if wait_ns < -LATE_NS:
                self.skipped += 1
            elif wait_ns > 0 and self._stop.wait(wait_ns / 1e9):
                return None
            elif (picture := self._video.retrieve(t_unix_ns)) is not None:
                return picture
        return None

    @property
    def remarks(self) -> list[Remark]:
        """The file's."""
        return self._video.remarks

    def _due(self, t_unix_ns: int) -> int:
        if self._wall_minus_stamp is None:
            start = self._now() if self._start_at is None else self._start_at
            self._wall_minus_stamp = start - t_unix_ns
        return t_unix_ns + self._wall_minus_stamp

    def close(self) -> None:
        """Close the file."""
        self._video.close()
