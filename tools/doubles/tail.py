"""Recordings read as they grow: each byte once, however often one looks.

A bench that read whole files again and again would take from the base the time that it measures.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from calib.station.core.playback import Recorded

MAGIC_BYTES: Final = 8
HEAD: Final = struct.Struct("<BQ")  # opcode, length
CHANNEL, MESSAGE = 0x04, 0x05
MESSAGE_HEAD: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time


class Tail:
    """The messages that came into a folder of recordings since the last look. Our recorder writes no chunks."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._at: dict[Path, int] = {}
        self._topics: dict[Path, dict[int, str]] = {}

    def new(self) -> Iterator[Recorded]:
        """What is complete and was not told before, file by file."""
        for file in sorted(self._folder.glob("*.mcap")):
            yield from self._of(file)

    def _of(self, file: Path) -> Iterator[Recorded]:
        at = self._at.setdefault(file, MAGIC_BYTES)
        topics = self._topics.setdefault(file, {})
        with file.open("rb") as stream:
            stream.seek(at)
            data = stream.read()
        begin = 0
        while begin + HEAD.size <= len(data):
            opcode, length = HEAD.unpack_from(data, begin)
            body = begin + HEAD.size
            if body + length > len(data):
                break
            if opcode == CHANNEL:
                number, _, size = struct.unpack_from("<HHI", data, body)
                topics[number] = data[body + 8 : body + 8 + size].decode()
            elif opcode == MESSAGE:
                number, _, log_time, _ = MESSAGE_HEAD.unpack_from(data, body)
                yield Recorded(topics[number], log_time, data[body + MESSAGE_HEAD.size : body + length])
            begin = body + length
        self._at[file] = at + begin
