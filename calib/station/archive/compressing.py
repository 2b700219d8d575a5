"""A finished recording made small: the same messages in the same order, in zstd chunks with an index.

Not while it is written: a chunk gathered in memory is lost to a power cut, and a recording may be cut off at any byte.
So a file is compressed once the next one is begun, by a process of its own that steps back for what is live;
`python -m calib.station.archive.compressing FILE`. The new file takes the old one's place only when it was read again
and holds just what the old one held. Cut off later, it can be read up to its last whole chunk.
"""

import hashlib
import os
import sys
from pathlib import Path
from typing import Final

from mcap.records import Channel, Header, Message, Schema
from mcap.writer import CompressionType, Writer

from calib.station.archive.recording import read, records
from edge.common.errors import RecordingError
from edge.common.niceness import step_back

CHUNK_BYTES: Final = 1 << 18  # before compression; of three cameras and one drone some seconds
PART: Final = ".part"  # the name of a file that is not whole yet ends so
NICE: Final = 15  # of 19: behind whatever is live
_MAGIC: Final = b"\x89MCAP0\r\n"
_HEADER, _CHUNK = 1, 6  # opcodes


def is_compressed(path: Path) -> bool:
    """Whether a recording is in chunks already: the first thing after its header is one."""
    with path.open("rb") as stream:
        if stream.read(len(_MAGIC)) != _MAGIC or stream.read(1) != bytes([_HEADER]):
            return False
        stream.seek(int.from_bytes(stream.read(8), "little"), os.SEEK_CUR)
        return stream.read(1) == bytes([_CHUNK])


def compress(path: Path) -> None:
    """Compress a finished recording in place. Raises OSError, RecordingError; then the file is as it was."""
    part = path.with_name(path.name + PART)
    try:
        _rewrite(path, part)
        if _digest(part) != _digest(path):
            raise RecordingError("was not compressed truly", where=str(path), action="look at the disk; it is kept")
        part.chmod(path.stat().st_mode & 0o777)
        os.utime(part, ns=(path.stat().st_atime_ns, path.stat().st_mtime_ns))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _rewrite(path: Path, part: Path) -> None:
    schemas: dict[int, int] = {0: 0}  # the old file's numbers, ours; 0: without one
    channels: dict[int, int] = {}
    with part.open("xb") as target:
        writer = Writer(target, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        for record in records(path):
            if isinstance(record, Header):
                writer.start(record.profile, record.library)
            elif isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in channels:
                schema = schemas.get(record.schema_id, 0)
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schema, record.metadata
                )
            elif isinstance(record, Message) and record.channel_id in channels:
                channel = channels[record.channel_id]
                writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
        writer.finish()
        target.flush()
        os.fsync(target.fileno())


def _digest(path: Path) -> bytes:
    """Of all messages in order: key, arrival, bytes."""
    digest = hashlib.sha256()
    for message in read(path):
        digest.update(f"{message.key} {message.t_arrival_ns} {len(message.payload)} ".encode())
        digest.update(message.payload)
    return digest.digest()


def main(paths: list[str]) -> int:
    """Compress each of these files; 1 if one could not be, with the reason on the standard error."""
    for path in map(Path, paths):
        try:
            if not is_compressed(path):
                compress(path)
        except (OSError, RecordingError) as error:
            sys.stderr.write(f"{path}: {error}\n")
            return 1
    return 0


if __name__ == "__main__":  # a process of its own: whoever calls main in theirs stays as ready as they were
    step_back(NICE)
    sys.exit(main(sys.argv[1:]))
