"""Which recordings stay: what is finished is made small, and when room runs out the oldest goes, not the newest.

The hazard is the full disk at the end of a week: what is flown then is what somebody came for. So a thread looks every
few seconds, removes the oldest recording of this site when there is less room than is asked for, says so, and never
touches the file that is being written, nor anybody else's. Who would rather keep the oldest says when_full = "stop".
"""

import logging
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from calib.station.archive.compressing import PART, is_compressed
from calib.station.config import RecordingSection
from edge.common.health import Check
from edge.common.own_thread import OwnThread

log = logging.getLogger(__name__)

LOOK_AGAIN_S: Final = 5.0
HEADROOM_BYTES: Final = 100 * 10**6  # room is made so long before recording would stop; at 40 kB/s that is 40 minutes
AT_REST_S: Final = 10.0  # a file that was written to since is perhaps another process's
KEPT_CLOSE_S: Final = 1.0
TOLD_S: Final = 3600.0  # how long it is said that a recording was removed


class KeptRecordings(OwnThread):
    """Keeps the recordings of one site in one folder within their limits while it is entered."""

    def __init__(self, folder: Path, site: str, options: RecordingSection, current: Callable[[], Path | None]) -> None:
        """current: the file that is written now, which is let alone."""
        super().__init__("recordings", KEPT_CLOSE_S)
        self._folder, self._options, self._current = folder, options, current
        self._ours = re.compile(rf"{re.escape(site)}-\d{{8}}T\d{{6}}(-\d+)?\.mcap")
        self._child: subprocess.Popen[str] | None = None
        self._child_file = Path()
        self._given_up: set[Path] = set()
        self._removed_s = 0.0
        self._last_removed = ""
        self.removed = self.compressed = 0
        self._files = 0
        self._bytes = 0

    @property
    def counters(self) -> dict[str, float]:
        """What it did since the start; every number only grows."""
        return {"recordings_removed": float(self.removed), "recordings_compressed": float(self.compressed)}

    def check(self) -> Check:
        """What there is, and what had to go within the last hour."""
        kept = f"{self._files} recordings, {self._bytes / 1e9:.2f} GB"
        if self._last_removed and time.monotonic() - self._removed_s < TOLD_S:
            action = "take what you need elsewhere, or give it a larger disk"
            return Check("recordings", "warn", f"{kept}; {self._last_removed} was the oldest and made room", action)
        return Check("recordings", "ok", kept)

    def _run(self) -> None:
        for left_behind in self._folder.glob(f"*{PART}"):
            left_behind.unlink(missing_ok=True)
        while True:
            try:
                self._look()
            except OSError as error:
                log.warning("%s: cannot be looked after (%s)", self._folder, error)
            if self._stop.wait(LOOK_AGAIN_S):
                break
        if self._child is not None:
            self._child.terminate()
            self._child.communicate()

    def _look(self) -> None:
        if not self._folder.is_dir():
            return
        files = sorted(path for path in self._folder.iterdir() if self._ours.fullmatch(path.name))
        sizes = {path: path.stat().st_size for path in files}
        self._files, self._bytes = len(files), sum(sizes.values())
        current = self._current()
        finished = [path for path in files if path != current]
        if finished and self._lacks_room():
            self._remove(finished[0], sizes[finished[0]])
        elif self._options.compress:
            self._compress_next(finished)

    def _lacks_room(self) -> bool:
        limit_mb = self._options.max_total_mb
        if limit_mb is not None and self._bytes > limit_mb * 10**6:
            return True
        free = shutil.disk_usage(self._folder).free
        return self._options.when_full == "oldest_out" and free < self._options.min_free_mb * 10**6 + HEADROOM_BYTES

    def _remove(self, path: Path, size: int) -> None:
        path.unlink()
        self.removed += 1
        self._removed_s, self._last_removed = time.monotonic(), path.name
        log.warning("%s: removed, the oldest of %d recordings; %.0f MB of room", path, self._files, size / 1e6)

    def _compress_next(self, finished: list[Path]) -> None:
        if self._child is not None:
            if self._child.poll() is None:
                return
            self._take_result(self._child)
        now_s = time.time()
        for path in finished:
            if path in self._given_up or now_s - path.stat().st_mtime < AT_REST_S or is_compressed(path):
                continue
            command = [sys.executable, "-m", "calib.station.archive.compressing", str(path)]
            self._child = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
            self._child_file = path
            return

    def _take_result(self, child: "subprocess.Popen[str]") -> None:
        self._child = None
        told = child.communicate()[1].strip()
        if child.returncode == 0:
            self.compressed += 1
            return
        self._given_up.add(self._child_file)
        if self._child_file.exists():  # it may have been the oldest meanwhile
            log.warning("%s: stays as large as it is (%s)", self._child_file, told or child.returncode)
