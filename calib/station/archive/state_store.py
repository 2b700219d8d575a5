"""What a station keeps over a restart: its network, how often it started, which numbers are taken, the signing time.

The hazards: a power cut in the middle of writing, so files are replaced in one step; a disk that takes its time, so a
thread of its own writes; and a number given twice, so numbers are put aside by the hundred before they are used. And
another version of this program, before an upgrade or after a step back: what it wrote and this one does not know is no
damage, so a file is held against what was written, and not against what would be written now; keys that are not known
are kept; and what cannot be used is set aside, not overwritten.
"""

import hashlib
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
TICKS_BACK: Final = 3600 * 100_000  # an hour: more than is put aside over many starts that were each killed
EPOCHS_ON_WIRE: Final = 65_536  # the field on the wire has 16 bits
NETWORK: Final = "network.toml"
COUNTERS: Final = "counters.json"
MARK: Final = "# fingerprint "  # of the text below it, or of its numbers as this version writes them
DIGITS: Final = 12  # of a fingerprint, hexadecimal
ASIDE: Final = ".aside"
BEFORE: Final = ".before"  # the counters as they were written the time before
REPORT_FOLDER: Final = "report"  # below the state folder: the report on the calibration in force
STORE_CLOSE_S: Final = 1.5


class _Counters(msgspec.Struct):
    epoch: int = 0
    next_track: int = 1
    signing_ticks: int = 0

    def after(self) -> "_Counters":
        """Those of the next start, with numbers put aside."""
        epoch = (self.epoch + 1) % EPOCHS_ON_WIRE or 1
        return _Counters(epoch, self.next_track + TRACKS_ASIDE, self.signing_ticks + TICKS_ASIDE)


class StateStore(OwnThread):
    """Loads the memory, counts this start, and from then on writes what changes, in a thread of its own."""

    def __init__(self, folder: Path) -> None:
        super().__init__("keeper", STORE_CLOSE_S)
        self._folder = folder
        self._counters = _Counters()
        self._unknown: dict[str, object] = {}  # counters of a later version
        self._queue: queue.SimpleQueue[tuple[Path, bytes] | None] = queue.SimpleQueue()
        self.fault = ""

    def load(self, cameras: set[str]) -> StoredState:
        """What an earlier run left; a network of other cameras, or a damaged one, is not believed."""
        old = self._load_counters()
        self._counters = old.after()
        self._write(self._folder / COUNTERS, self._encoded_counters())
        network = self.stored_network(cameras)
        if network is None:
            self._set_network_aside()
        return StoredState(self._counters.epoch, old.next_track, old.signing_ticks, network)

    def store_network(self, network: Network) -> None:
        """Keep a network for the next start."""
        text = f"{MARK}{network.fingerprint}\n{to_toml(network)}"
        self._queue.put((self._folder / NETWORK, text.encode()))

    def note(self, next_track: int, signing_ticks: int) -> None:
        """Put numbers and signing time aside when what was put aside runs out, or the time was taken back by far."""
        kept = self._counters
        taken_back = 0 < signing_ticks < kept.signing_ticks - TICKS_BACK
        if next_track + TRACKS_ASIDE // 2 > kept.next_track or signing_ticks > kept.signing_ticks or taken_back:
            aside = signing_ticks + TICKS_ASIDE if signing_ticks else kept.signing_ticks
            self._counters = _Counters(kept.epoch, next_track + TRACKS_ASIDE, aside)
            self._queue.put((self._folder / COUNTERS, self._encoded_counters()))

    def _encoded_counters(self) -> bytes:
        return msgspec.json.encode(self._unknown | msgspec.structs.asdict(self._counters))

    def _load_counters(self) -> _Counters:
        path = self._folder / COUNTERS
        try:
            return self._read_counters(path)
        except FileNotFoundError:
            return _Counters()
        except (OSError, msgspec.MsgspecError) as error:
            before = path.with_name(path.name + BEFORE)
            try:
                counters = self._read_counters(before).after()  # it has not seen the last start and the last numbers
            except (OSError, msgspec.MsgspecError):
                log.warning("%s: cannot be read (%s); counting starts anew", path, error)
                return _Counters()
            log.warning("%s: cannot be read (%s); counting goes on from %s", path, error, before)
            return counters

    def _read_counters(self, path: Path) -> _Counters:
        content = path.read_bytes()
        counters = msgspec.json.decode(content, type=_Counters)
        known = set(_Counters.__struct_fields__)
        self._unknown = {name: value for name, value in msgspec.json.decode(content).items() if name not in known}
        return counters

    def _set_network_aside(self) -> None:
        """What is not used, but may be by another version or with other cameras, is not written over."""
        path = self._folder / NETWORK
        try:
            path.rename(path.with_name(path.name + ASIDE))
        except FileNotFoundError:
            return
        except OSError as error:
            log.warning("%s: cannot be set aside (%s)", path, error)

    def stored_network(self, cameras: set[str]) -> Network | None:
        """The stored network, if it is whole and of these cameras."""
        path = self._folder / NETWORK
        try:
            text = path.read_text(encoding="utf-8")
            network = from_toml(text, where=str(path))
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError, CalibrationError) as error:
            log.warning("%s: not used (%s); calibrating anew", path, error)
            return None
        if not _is_whole(text, network):
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
            if path.name == COUNTERS:
                self._keep_before(path)
            write_atomically(path, content, mode=0o600)
            self.fault = ""
        except OSError as error:
            if not self.fault:
                log.warning("%s: cannot be written (%s); a restart will not remember", path, error)
            self.fault = f"{path.name} cannot be written ({error})"

    @staticmethod
    def _keep_before(path: Path) -> None:
        """The counters that are there, if they are whole, in case the new ones are found damaged."""
        try:
            content = path.read_bytes()
            msgspec.json.decode(content, type=_Counters)
        except (OSError, msgspec.MsgspecError):
            return
        write_atomically(path.with_name(path.name + BEFORE), content, mode=0o600)


def _is_whole(text: str, network: Network) -> bool:
    """Whether a stored network is what was written: its text, whichever version wrote it, or else its numbers."""
    marked = next((line for line in text.splitlines() if line.startswith(MARK)), "")
    body = text.partition(f"{marked}\n")[2]
    of_text = hashlib.sha256(body.encode()).hexdigest()[:DIGITS]
    return bool(marked) and marked.removeprefix(MARK) in (of_text, network.fingerprint)
