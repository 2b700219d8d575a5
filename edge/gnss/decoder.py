"""What a receiver's protocol is: how its frames are told from noise, and what its messages say in neutral Parts.

One protocol is one class, in a file of its own in decoders/, and its line in the registry there. Framing, joining,
gates and averaging know of protocols nothing but this.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from edge.gnss.epoch import Part


class MalformedError(ValueError):
    """A message passed its checksum and still is not what it claims; the text says which."""


@dataclass(frozen=True)
class Cut:
    """What lies at a sync. end: where to go on. body: the frame there, None if there is none. checksum_failed: why."""

    end: int
    body: bytes | None = None
    checksum_failed: bool = False


class Decoder(ABC):
    """One protocol. name: in the configuration and in counters. sync: the bytes that each of its frames begins with.

    wanted: the messages that make a survey possible, for the advice to make the receiver send them.
    """

    name: ClassVar[str]
    sync: ClassVar[bytes]
    wanted: ClassVar[str]

    @abstractmethod
    def cut(self, buffer: bytes, start: int) -> Cut | None:
        """What lies in `buffer` at `start`, where `sync` was found; None if the frame may yet come.

        A frame whose check fails ends one byte after its start, never behind the length it claims.
        """

    @abstractmethod
    def decode(self, body: bytes) -> Part | None:
        """What a frame says; None for one that is not used. Raises MalformedError where it breaks its own rules."""
