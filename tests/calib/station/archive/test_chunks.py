"""Compressed recordings that are made to fill the memory: refused, and at once."""

import random
import struct
import tracemalloc
from pathlib import Path

import lz4.frame
import pytest
import zstandard

from calib.station.archive.chunks import LARGEST_CHUNK
from calib.station.archive.recording import read
from edge.common.errors import RecordingError

BLOCK = 1 << 20
MAGIC = b"\x89MCAP0\r\n"


def packed(kind: str, size: int, fill: bytes, *, tells: bool) -> bytes:
    """`size` bytes of `fill`, compressed. tells: whether the frame's own head says how many."""
    block = fill * (BLOCK // len(fill))
    if kind == "zstd":
        zstd = zstandard.ZstdCompressor(level=1).compressobj(size=size if tells else -1)
        return b"".join(zstd.compress(block) for _ in range(size // BLOCK)) + zstd.flush()
    lz4_frame = lz4.frame.LZ4FrameCompressor()
    begun = lz4_frame.begin(source_size=size if tells else 0)
    return begun + b"".join(lz4_frame.compress(block) for _ in range(size // BLOCK)) + lz4_frame.flush()


def mcap(kind: str, claimed: int, data: bytes) -> bytes:
    """A recording of one chunk."""

    def record(opcode: int, body: bytes) -> bytes:
        return struct.pack("<BQ", opcode, len(body)) + body

    def text(words: str) -> bytes:
        return struct.pack("<I", len(words)) + words.encode()

    chunk = struct.pack("<QQQI", 0, 0, claimed, 0) + text(kind) + struct.pack("<Q", len(data)) + data
    return MAGIC + record(1, text("") + text("x")) + record(6, chunk)


@pytest.mark.parametrize("seed", range(10))
def test_bombs_are_refused_before_they_unfold(tmp_path: Path, seed: int) -> None:
    """Truly large or only dense, what their heads say true, small, none or absurd."""
    draw = random.Random(seed)
    kind = draw.choice(["zstd", "lz4"])
    size = draw.choice([8, 64, 256]) * BLOCK
    data = packed(kind, size, draw.choice([b"\0", b"\3" + b"\0" * 15]), tells=draw.random() < 0.5)
    claimed = draw.choice([size, 100, 0, 1 << 60])
    file = tmp_path / "bomb.mcap"
    file.write_bytes(mcap(kind, claimed, data))
    tracemalloc.start()
    try:
        if kind == "lz4" and size < LARGEST_CHUNK and claimed < LARGEST_CHUNK:
            list(read(file))  # lz4 makes nothing 250 times smaller: eight megabytes are all that it is
        else:
            with pytest.raises(RecordingError, match="unpack"):
                list(read(file))
        assert tracemalloc.get_traced_memory()[1] < 4 * LARGEST_CHUNK
    finally:
        tracemalloc.stop()


def test_a_chunk_that_holds_less_than_it_says_breaks_off(tmp_path: Path) -> None:
    file = tmp_path / "short.mcap"
    file.write_bytes(mcap("zstd", 5000, zstandard.compress(b"\7" * 4000)))
    assert list(read(file)) == []
