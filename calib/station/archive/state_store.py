"""What a station keeps over a restart: its network, how often it started, which numbers are taken, the signing time.

The hazards: a power cut in the middle of writing, so files are replaced in one step; a disk that takes its time, so a
thread of its own writes; and a number given twice, so numbers are put aside by the hundred before they are used.
"""

import logging
import queue
from pathlib import Path
from typing import Final

import msgspec

from calib.errors import CalibrationError
from calib.network import Network, from_toml, to_toml
from calib.station.core.stored_state import StoredState
from edge.common.atomic import write_atomically
from edge.common.own_thread import OwnThread

log = logging.getLogger(__name__)

TRACKS_ASIDE: Final = 100  # numbers put aside at each writing
TICKS_ASIDE: Final = 60 * 100_000  # signing time: a minute, in ticks of 10 us; the file is written once a minute
EPOCHS_ON_WIRE: Final = 65_536  # the field on the wire has 16 bits
MARK: Final = "# fingerprint "
REPORT_FOLDER: Final = "report"  # below the state folder: the report on the calibration in force
STORE_CLOSE_S: Final = 1.5


class _Counters(msgspec.Struct):
    epoch: int = 0
    next_track: int = 1
    signing_ticks: int = 0


class StateStore(OwnThread):
    """Loads the memory, counts this start, and from then on writes what changes, in a thread of its own."""

    def __init__(self, folder: Path) -> None:
        super().__init__("keeper", STORE_CLOSE_S)
        self._folder = folder
        self._counters = _Counters()
        self._queue: queue.SimpleQueue[tuple[Path, bytes] | None] = queue.SimpleQueue()
        self.fault = ""

    def load(self, cameras: set[str]) -> StoredState:
        """What an earlier run left; a network of other cameras, or a damaged one, is not believed."""
        old = self._load_counters()
        epoch = (old.epoch + 1) % EPOCHS_ON_WIRE or 1
        self._counters = _Counters(epoch, old.next_track + TRACKS_ASIDE, old.signing_ticks + TICKS_ASIDE)
        self._write(self._folder / "counters.json", msgspec.json.encode(self._counters))
        return StoredState(epoch, old.next_track, old.signing_ticks, self.stored_network(cameras))

    def store_network(self, network: Network) -> None:
        """Keep a network for the next start."""
        text = f"{MARK}{network.fingerprint}\n{to_toml(network)}"
        self._queue.put((self._folder / "network.toml", text.encode()))

    def note(self, next_track: int, signing_ticks: int) -> None:
        """Put numbers and signing time aside when what was put aside runs out."""
        kept = self._counters
        if next_track + TRACKS_ASIDE // 2 > kept.next_track or signing_ticks > kept.signing_ticks:
            self._counters = _Counters(kept.epoch, next_track + TRACKS_ASIDE, signing_ticks + TICKS_ASIDE)
            self._queue.put((self._folder / "counters.json", msgspec.json.encode(self._counters)))

    def _load_counters(self) -> _Counters:
        path = self._folder / "counters.json"
        try:
            return msgspec.json.decode(path.read_bytes(), type=_Counters)
        except FileNotFoundError:
            return _Counters()
        except (OSError, msgspec.MsgspecError) as error:
            log.warning("%s: cannot be read (%s); counting starts anew", path, error)
            return _Counters()

    def stored_network(self, cameras: set[str]) -> Network | None:
        """The stored network, if it is whole and of these cameras."""
        path = self._folder / "network.toml"
        try:
            text = path.read_text(encoding="utf-8")
            network = from_toml(text, where=str(path))
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError, CalibrationError) as error:
            log.warning("%s: not used (%s); calibrating anew", path, error)
            return None
        if text.splitlines()[0] != f"{MARK}{network.fingerprint}":
            log.warning("%s: not used, its fingerprint is not that of its numbers; calibrating anew", path)
            return None
        strangers = {camera.id for camera in network.cameras} - cameras
        if strangers:
            log.warning("%s: not used, it holds %s, not configured; calibrating anew", path, ", ".join(strangers))
            return None
        return network

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            self._write(*item)

    def _wake(self) -> None:
        self._queue.put(None)  # behind all that is still to be written

    def _write(self, path: Path, content: bytes) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, content, mode=0o600)
            self.fault = ""
        except OSError as error:
            if not self.fault:
                log.warning("%s: cannot be written (%s); a restart will not remember", path, error)
            self.fault = f"{path.name} cannot be written ({error})"
