"""Recordings: everything received and sent, as it came, in MCAP.

The hazard is the end that never comes: power cuts, kill -9, a full disk. So nothing waits in a buffer: each message is
in the file before anything is computed from it, messages are not gathered into chunks, and a file without an end is
read up to where it breaks off. Only when a file is finished is it compressed, in chunks (compressing.py); no reader
need know. And a file without its beginning: what was said once, long ago, the survey, a lens, is said again at the head
of every file, so that each can be solved by itself. Foxglove opens the files as they are: one channel a key, JSON with
its schema.
"""

import logging
import os
import shutil
import struct
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import msgspec
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, McapRecord, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer
from zstandard import ZstdError

from calib.station.archive.chunks import records_of
from calib.station.core.playback import Recorded
from edge import __version__
from edge.common.errors import RecordingError
from edge.common.own_thread import OwnThread
from edge.messages import MESSAGES

log = logging.getLogger(__name__)

SYNC_S: Final = 2.0  # the most a power cut may cost
SYNC_CLOSE_S: Final = 1.5  # for the last push; a card that takes longer is left to it
LONGEST_RECORD: Final = 1 << 24  # bytes: a length beyond it is damage, not a message
# What mcap raises where a file is damaged or cut off.
BROKEN: Final = (
    McapError,
    ZstdError,
    struct.error,
    EOFError,
    ValueError,
    MemoryError,
    OverflowError,
    RuntimeError,
)
CHECK_DISK_NS: Final = 5_000_000_000
STATE_TOPICS: Final = ("survey", "lens", "fix", "calibration")  # said once and holding on: each file begins with them
FREE_JSON: Final = b'{"type": "object"}'
RECORDING_MODE: Final = 0o640  # of a file: whose cameras stand where is not everybody's business
MOST_KEYS: Final = 1000  # of one file, far beyond any site; the format itself counts to 65535, and each takes 2 kB


class _Syncer(OwnThread):
    """Pushes a file to the disk every other second: fsync takes as long as the card does."""

    def __init__(self, descriptor: int) -> None:
        super().__init__("recording-sync", SYNC_CLOSE_S)
        self._descriptor = descriptor

    def _run(self) -> None:
        while not self._stop.wait(SYNC_S):
            self._push()
        self._push()
        os.close(self._descriptor)

    def _push(self) -> None:
        try:
            os.fsync(self._descriptor)
        except OSError as error:  # the next write fails too, and says so where it is noticed
            log.debug("fsync: %s", error)


class _Unbuffered:
    """A file that has what was written the moment it was written. The MCAP writer would put a buffer before a raw one.

    The thread that pushes it to the disk also closes it, so a disk that hangs does not hold up who wants it closed.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, RECORDING_MODE)
        self._at = 0
        self._syncer = _Syncer(self._descriptor).__enter__()

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:
            written = os.write(self._descriptor, rest)
            self._at += written
            rest = rest[written:]
        return len(data)

    def tell(self) -> int:
        return self._at

    def flush(self) -> None:
        """Nothing waits here."""

    def close(self) -> None:
        self._syncer.close()


class Recorder:
    """Appends messages to files of limited size in a folder. A disk that fails stops the recording, not the caller."""

    def __init__(self, folder: Path, site: str, *, max_file_mb: int = 200, min_free_mb: int = 500) -> None:
        self._folder, self._site = folder, site
        self._max_bytes, self._min_free_bytes = max_file_mb * 10**6, min_free_mb * 10**6
        self._writer: Writer | None = None
        self._channels: dict[str, int] = {}
        self._states: dict[str, bytes] = {}  # the last message of each key of STATE_TOPICS
        self._disk_ns = 0
        self._full = False
        self.path: Path | None = None
        self.messages = 0
        self.fault = ""
        self.left_out = 0  # messages of keys beyond MOST_KEYS

    def write(self, key: str, payload: bytes, now_ns: int, t_message_ns: int | None = None) -> None:
        """Put one message into the file. now_ns: UTC of its arrival."""
        if self._full and now_ns < self._disk_ns:
            self.hold(key, payload)
            return
        try:
            if self._writer is None or self._writer_is_long():
                self._begin(now_ns)
            self.hold(key, payload)
            if now_ns >= self._disk_ns:
                self._look_at_disk(now_ns)
            if self._full or self._writer is None:
                return
            self._add(key, payload, now_ns, t_message_ns or now_ns)
        except OSError as error:
            self._stop(now_ns, f"recording stopped: {error}")

    def hold(self, key: str, payload: bytes) -> None:
        """Note a message of a state while nothing is recorded: each file begins with the states then in force."""
        if key.rpartition("/")[2] in STATE_TOPICS and (key in self._states or len(self._states) < MOST_KEYS):
            self._states[key] = payload

    def _add(self, key: str, payload: bytes, now_ns: int, t_message_ns: int) -> None:
        assert self._writer is not None
        channel = self._channels.get(key)
        if channel is None and len(self._channels) >= MOST_KEYS:
            self.left_out += 1
            return
        if channel is None:
            channel = self._register(key)
        self._writer.add_message(channel, now_ns, payload, t_message_ns, self.messages & 0xFFFFFFFF)
        self.messages += 1

    @property
    def current(self) -> Path | None:
        """The file that is being written."""
        return None if self._writer is None else self.path

    def close(self) -> None:
        """Give the file its end."""
        self._end()

    def _writer_is_long(self) -> bool:
        return self._stream.tell() > self._max_bytes

    def _begin(self, now_ns: int) -> None:
        self._end()
        self._folder.mkdir(parents=True, exist_ok=True)
        name = datetime.fromtimestamp(now_ns * 1e-9, UTC).strftime("%Y%m%dT%H%M%S")
        path = next(
            p
            for p in (self._folder / f"{self._site}-{name}{suffix}.mcap" for suffix in ("", *map(_dash, range(1, 999))))
            if not p.exists()
        )
        self._stream = _Unbuffered(path)
        self.path, self._channels = path, {}
        self._writer = Writer(
            self._stream,
            use_chunking=False,
            compression=CompressionType.NONE,
            index_types=IndexType.NONE,
            enable_crcs=False,
        )
        self._writer.start(profile="skyfix", library=f"skyfix {__version__}")
        self._look_at_disk(now_ns)
        for key, payload in self._states.items() if not self._full else ():
            self._add(key, payload, now_ns, now_ns)

    def _end(self) -> None:
        if self._writer is None:
            return
        writer, self._writer = self._writer, None
        try:
            writer.finish()
        except OSError as error:
            self.fault = f"recording was not finished: {error}"
            log.warning("%s: %s", self.path, self.fault)
        finally:
            self._stream.close()

    def _register(self, key: str) -> int:
        assert self._writer is not None
        kind = "/".join((key.split("/")[3], key.rpartition("/")[2])) if key.count("/") >= 4 else key
        struct_type = MESSAGES.get(kind)
        schema = FREE_JSON if struct_type is None else msgspec.json.encode(msgspec.json.schema(struct_type))
        name = kind if struct_type is None else struct_type.__name__
        schema_id = self._writer.register_schema(name, "jsonschema", schema)
        self._channels[key] = int(self._writer.register_channel(key, "json", schema_id))
        return self._channels[key]

    def _look_at_disk(self, now_ns: int) -> None:
        self._disk_ns = now_ns + CHECK_DISK_NS
        free = shutil.disk_usage(self._folder).free
        self._full = free < self._min_free_bytes
        fault = f"recording paused: {free // 10**6} MB left on the disk" if self._full else ""
        if fault and not self.fault:
            log.warning("%s: %s; free some space", self._folder, fault)
        self.fault = fault

    def _stop(self, now_ns: int, fault: str) -> None:
        log.warning("%s: %s; targets go on, look at the disk", self._folder, fault)
        self.fault, self._full, self._disk_ns = fault, True, now_ns + CHECK_DISK_NS
        if self._writer is not None:
            self._writer = None
            self._stream.close()


def _dash(number: int) -> str:
    return f"-{number}"


def read(path: Path) -> Iterator[Recorded]:
    """The messages of a recording in the order they came, up to its end or to where it breaks off.

    Of a compressed one, up to its last whole chunk. Raises RecordingError if there is no such file or it is no
    recording at all.
    """
    topics: dict[int, str] = {}
    for record in records(path):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message) and record.channel_id in topics:
            yield Recorded(topics[record.channel_id], record.log_time, record.data)


def records(path: Path) -> Iterator[McapRecord]:
    """What a file is made of, chunks taken apart, up to its end or to where it breaks off. Raises RecordingError, also
    where a chunk unpacks to more than any recorder writes.
    """
    try:
        stream = path.open("rb")
    except OSError as error:
        raise RecordingError(f"cannot be read ({error})", where=str(path), action="give a .mcap file") from error
    some = False
    with stream:
        try:
            reader = StreamReader(stream, emit_chunks=True, record_size_limit=LONGEST_RECORD, validate_crcs=True)
            for whole in reader.records:
                for record in records_of(whole, str(path)) if isinstance(whole, Chunk) else (whole,):
                    some = some or isinstance(record, Channel)
                    yield record
        except BROKEN as error:
            if not some and stream.tell() > 0 and not _begins_like_mcap(path):
                raise RecordingError(
                    f"is no recording ({error})", where=str(path), action="give a .mcap file"
                ) from error
            log.info("%s: breaks off (%s); read up to there", path, error)


def _begins_like_mcap(path: Path) -> bool:
    with path.open("rb") as stream:
        return b"\x89MCAP0\r\n".startswith(stream.read(8))
