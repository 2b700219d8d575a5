"""The station's own recording: on while the operator wants it, and what the rest of the station has to know of it."""

import shutil
from pathlib import Path

from calib.station.archive.kept_recordings import KeptRecordings
from calib.station.archive.recording import Recorder
from calib.station.config import RecordingSection
from edge.common.health import Check


class StationRecording:
    """Everything received and sent, while it is on. Without a folder there is none."""

    def __init__(self, options: RecordingSection, folder: Path, site: str) -> None:
        """folder: what relative paths are relative to."""
        self.folder = None if options.folder is None else folder / options.folder
        self._recorder: Recorder | None = None
        if self.folder is not None:
            limits = {"max_file_mb": options.max_file_mb, "min_free_mb": options.min_free_mb}
            self._recorder = Recorder(self.folder, site, **limits)
        self.kept = None if self.folder is None else KeptRecordings(self.folder, site, options, self._written_now)
        self._on = self._recorder is not None

    def write(self, key: str, payload: bytes, now_ns: int) -> None:
        """Put one message into it. now_ns: UTC of its arrival."""
        if self._recorder is not None and self._on:
            self._recorder.write(key, payload, now_ns)
        else:
            self.hold(key, payload)

    def hold(self, key: str, payload: bytes) -> None:
        """Note a message that holds on, such as the survey: each file begins with the last of its key."""
        if self._recorder is not None:
            self._recorder.hold(key, payload)

    def switch(self, on: bool) -> None:
        """As the operator wants it; off gives the file its end."""
        self._on = on and self._recorder is not None
        if not self._on:
            self.close()

    def close(self) -> None:
        """Give the file its end."""
        if self._recorder is not None:
            self._recorder.close()

    def _written_now(self) -> Path | None:
        return None if self._recorder is None else self._recorder.current

    def checks(self) -> list[Check]:
        """What is kept, if anything is."""
        return [] if self.kept is None else [self.kept.check()]

    @property
    def counters(self) -> dict[str, float]:
        """What was removed, compressed and left out since the start."""
        left_out = 0 if self._recorder is None else self._recorder.left_out
        return ({} if self.kept is None else self.kept.counters) | {"recording_left_out": float(left_out)}

    @property
    def fault(self) -> str:
        """Why it does not record though it should; empty if it does."""
        return "" if self._recorder is None else self._recorder.fault

    @property
    def possible(self) -> bool:
        """Whether what comes now can be kept."""
        return self._recorder is not None and not self._recorder.fault

    @property
    def on(self) -> bool:
        """Whether what comes now is kept."""
        return self._on and self.possible

    @property
    def path(self) -> Path | None:
        """The file that is written now."""
        return None if self._recorder is None or not self._on else self._recorder.path

    @property
    def messages(self) -> int:
        """How many were recorded since the start."""
        return 0 if self._recorder is None else self._recorder.messages

    @property
    def free_mb(self) -> int | None:
        """What is left on its disk."""
        try:
            return None if self.folder is None else shutil.disk_usage(self.folder).free // 10**6
        except OSError:  # no such folder before the first recording
            return None
