"""The compressed part of a recording, taken apart within bounds.

The hazard is the bomb: thirty kilobytes that say they are a gigabyte, or do not say it and are. So no more is unpacked
than a chunk may hold, whatever its head claims, and what is too dense to be messages is refused.
"""

from dataclasses import replace
from typing import Final

import lz4.frame
import zstandard
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import breakup_chunk

from edge.common.errors import RecordingError

LARGEST_CHUNK: Final = 1 << 25  # bytes, unpacked: ours have 256 KiB, other programs' up to 4 MiB
DENSEST: Final = 500  # times smaller than unpacked: rows that hardly differ come to 50
SMALL: Final = 1 << 20  # bytes, unpacked: of so little any density is harmless
NOT_OURS: Final = "do not use it: no recorder writes such a thing, find out where it is from"


def records_of(chunk: Chunk, where: str) -> list[McapRecord]:
    """What a chunk holds, its checksum compared. Raises RecordingError for a bomb, and what mcap raises for damage."""
    if chunk.compression == "zstd":
        # Not `decompress`: that makes room for as much as the bytes themselves ask for.
        data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(LARGEST_CHUNK + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, LARGEST_CHUNK + 1)
    else:
        return _taken_apart(chunk)
    if len(data) < min(chunk.uncompressed_size, LARGEST_CHUNK):
        raise ValueError("a chunk breaks off")
    claimed = max(len(data), chunk.uncompressed_size)
    if claimed > LARGEST_CHUNK:
        raise RecordingError(
            f"holds {len(chunk.data)} bytes that unpack to more than {LARGEST_CHUNK >> 20} MiB",
            where=where,
            action=NOT_OURS,
        )
    if len(data) > max(SMALL, DENSEST * len(chunk.data)):
        raise RecordingError(
            f"holds {len(chunk.data)} bytes that unpack to {len(data)}: no messages", where=where, action=NOT_OURS
        )
    return _taken_apart(replace(chunk, compression="", data=data))


def _taken_apart(chunk: Chunk) -> list[McapRecord]:
    records: list[McapRecord] = breakup_chunk(chunk, validate_crc=True)
    return records
