"""When an MP4 or MOV file says that it was made: its movie header's creation time (ISO/IEC 14496-12, 8.2.2)."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

MAC_MINUS_UNIX_S: Final = 2_082_844_800  # that time counts from 1904
EARLIEST_UNIX_S: Final = 946_684_800  # 2000: a camera whose clock was never set says less


def creation_unix_s(path: Path | str) -> int | None:
    """The creation time in UNIX seconds, UTC; None if the file carries none, or one before 2000."""
    try:
        with Path(path).open("rb") as file:
            size = file.seek(0, 2)
            for kind, begin, end in _boxes(file, 0, size):
                if kind == b"moov":
                    headers = (at for name, at, _ in _boxes(file, begin, end) if name == b"mvhd")
                    return next((_created(file, at) for at in headers), None)
    except (OSError, struct.error):
        return None
    return None


def _boxes(file: BinaryIO, begin: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Name, begin and end of the contents of each box."""
    while begin + 8 <= end:
        file.seek(begin)
        length, name = struct.unpack(">I4s", file.read(8))
        head = 8
        if length == 1:
            (length,) = struct.unpack(">Q", file.read(8))
            head = 16
        length = length or end - begin
        if length < head:
            return
        yield name, begin + head, min(begin + length, end)
        begin += length


def _created(file: BinaryIO, at: int) -> int | None:
    file.seek(at)
    version = file.read(4)[0]
    (seconds,) = struct.unpack(">Q", file.read(8)) if version == 1 else struct.unpack(">I", file.read(4))
    unix_s = int(seconds) - MAC_MINUS_UNIX_S
    return unix_s if unix_s >= EARLIEST_UNIX_S else None
