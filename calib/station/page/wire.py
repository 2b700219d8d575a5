"""Packets between the station and its page: a name and bytes, over a socket that keeps packets whole.

The hazard is a page that is busy, stopped in a debugger or swapped out. The station therefore never waits: a packet
that does not fit now is dropped and counted, and the next one says the same thing newer.
"""

import socket
from typing import Final, Literal

import msgspec

from edge.common.errors import MessageError
from edge.link.settings import TlsSettings

LARGEST: Final = 1 << 17  # bytes: a status of 32 cameras is 40 kB, a preview 60 kB
BUFFER: Final = 1 << 20  # bytes: a second of everything


class OperatorCommand(msgspec.Struct, frozen=True, kw_only=True):
    """What the operator wants, from the page to the station."""

    do: Literal["mute", "unmute", "record", "stop", "calibrate"]
    camera: str = ""


class Hello(msgspec.Struct, frozen=True, kw_only=True):
    """What a page gets when it starts."""

    site: str
    token: str
    recordings: str | None
    tiles: str | None
    report: str
    tls: TlsSettings | None = None


def open_pair() -> tuple[socket.socket, socket.socket]:
    """The station's end, which never blocks, and the page's end."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
    ours.setblocking(False)
    return ours, theirs


def pack(name: str, payload: bytes) -> bytes:
    """One packet."""
    return name.encode() + b"\0" + payload


def unpack(packet: bytes) -> tuple[str, bytes]:
    """Name and payload of a packet. Raises MessageError if it is none."""
    name, zero, payload = packet.partition(b"\0")
    if not zero:
        raise MessageError("a packet without a name", where="page", action="this is a fault of ours: report it")
    return name.decode(), payload
