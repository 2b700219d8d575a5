"""The sockets MAVLink goes through: UDP, TCP dialled or listening, a serial line. None ever blocks the loop.

The hazard is a receiver that hangs. pymavlink's own connections swallow errors, look names up while sending, hold one
TCP client and lose the ends of partial writes. Here names are looked up once, every error is counted and the newest
kept for the operator, a client that does not read is dropped, and what is dialled is dialled again.
"""

import contextlib
import errno
import ipaddress
import os
import socket
import termios
from abc import ABC, abstractmethod
from collections import deque
from typing import Final

import serial

from edge.common.errors import ConfigError

LINK_READ_BYTES: Final = 2048  # at once: no datagram of MAVLink is longer
READS_A_POLL: Final = 16  # datagrams
BYTES_A_POLL: Final = 2048  # from which on a call reads no further: what hostile bytes cost to parse holds up targets
BACKLOG_BYTES: Final = 262_144  # per TCP client: seconds of full rate; more means it has stopped reading
MOST_CLIENTS: Final = 32  # of a listening endpoint: each gets all that is sent
CLIENTS_OF_ONE: Final = 8  # machines have a ground station, a logger, somebody's script
ACCEPTS_A_POLL: Final = 16
LINE_WAITING_S: Final = 0.5  # of a serial line's own rate: what waits longer is stale when its turn comes
LINE_LEAST_WAITING_BYTES: Final = 1024  # a few whole frames on the slowest line
BITS_A_BYTE: Final = 10  # on a serial line, start and stop included
# What goes by itself once the receiver is there, or reads again.
PATIENT: Final = frozenset(
    {errno.ECONNREFUSED, errno.ECONNRESET, errno.EPIPE, errno.ETIMEDOUT, errno.ENOBUFS, errno.EINPROGRESS}
)
REDIAL_NS: Final = 1_000_000_000
FORMS: Final = "udp:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or serial:DEVICE:BAUD"
IN_PROGRESS: Final = (errno.EINPROGRESS, errno.EALREADY, errno.EWOULDBLOCK)


class Endpoint(ABC):
    """Where frames go. `send` and `receive` never block and never raise; errors are counted, the last one kept."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.errors = 0
        self.sent_bytes = 0
        self.last_error = ""
        self.hopeless = False  # whether the last error is one that no receiver's starting mends

    @abstractmethod
    def send(self, frames: list[bytes], now_ns: int) -> None:
        """Send whole frames, in order."""

    @abstractmethod
    def receive(self, now_ns: int) -> list[tuple[int, bytes]]:
        """What came: (which peer, bytes)."""

    @property
    @abstractmethod
    def sources(self) -> list[int]:
        """The file descriptors that may have something to read."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the socket or device."""

    def _failed(self, error: OSError) -> None:
        self.errors += 1
        self.last_error = str(error)
        self.hopeless = error.errno not in PATIENT


def _total(came: list[tuple[int, bytes]]) -> int:
    return sum(len(data) for _, data in came)


class UdpEndpoint(Endpoint):
    """Datagrams to one address; answers come back to the same socket."""

    def __init__(self, url: str, address: tuple[str, int]) -> None:
        super().__init__(url)
        self._address = address
        family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        # A broadcast is asked for by whoever writes such an address.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.setblocking(False)
        if ipaddress.ip_address(address[0]).is_loopback:
            self._socket.bind((address[0], 0))  # who sends to this machine alone hears this machine alone

    def send(self, frames: list[bytes], now_ns: int) -> None:
        """A datagram a frame."""
        for frame in frames:
            try:
                self.sent_bytes += self._socket.sendto(frame, self._address)
            except OSError as error:
                self._failed(error)

    def receive(self, now_ns: int) -> list[tuple[int, bytes]]:
        """The datagrams that came, a few a call; the peer is always 0."""
        came: list[tuple[int, bytes]] = []
        while len(came) < READS_A_POLL and _total(came) < BYTES_A_POLL:
            try:
                came.append((0, self._socket.recv(LINK_READ_BYTES)))
            except BlockingIOError:
                break
            except OSError as error:  # what the network reports of datagrams sent
                self._failed(error)
                break
        return came

    @property
    def sources(self) -> list[int]:
        """As `Endpoint` has it."""
        return [self._socket.fileno()]

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class _Stream:
    """A connected TCP socket with what it has not yet taken. address: of a client's machine."""

    def __init__(self, connection: socket.socket, address: str) -> None:
        self.connection, self.address = connection, address
        self.waiting = bytearray()
        connection.setblocking(False)

    def push(self, frames: list[bytes]) -> int:
        """Queue frames and write what goes; bytes written. Raises OSError when the peer is gone or does not read."""
        self.waiting += b"".join(frames)
        if len(self.waiting) > BACKLOG_BYTES:
            raise OSError(errno.ENOBUFS, "peer does not read")
        try:
            written = self.connection.send(self.waiting) if self.waiting else 0
        except BlockingIOError:
            return 0
        del self.waiting[:written]
        return written

    def pull(self) -> bytes:
        """What came. Raises OSError when the peer is gone."""
        try:
            data = self.connection.recv(LINK_READ_BYTES)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError(errno.ECONNRESET, "closed by the peer")
        return data


class TcpEndpoint(Endpoint):
    """TCP, dialling a server or serving clients: so many at most, and of one address its share."""

    def __init__(self, url: str, address: tuple[str, int], *, listen: bool) -> None:
        super().__init__(url)
        self._address = address
        self._streams: dict[int, _Stream] = {}
        self._numbers = 0
        self._dialling: socket.socket | None = None
        self._redial_ns = 0
        self._server: socket.socket | None = None
        if listen:
            family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
            both = address[0] == "::" and socket.has_dualstack_ipv6()
            self._server = socket.create_server(address, family=family, dualstack_ipv6=both)
            self._server.setblocking(False)

    def send(self, frames: list[bytes], now_ns: int) -> None:
        """To each client, or to the server; who does not read is dropped."""
        self._welcome(now_ns)
        for number, stream in list(self._streams.items()):
            try:
                self.sent_bytes += stream.push(frames)
            except OSError as error:
                self._drop(number, error)

    def receive(self, now_ns: int) -> list[tuple[int, bytes]]:
        """What came from each client, by its number, a little a call; whoever was not read is first the next time."""
        self._welcome(now_ns)
        came: list[tuple[int, bytes]] = []
        for number, stream in list(self._streams.items()):
            if _total(came) >= BYTES_A_POLL:
                break
            try:
                data = stream.pull()
            except OSError as error:
                self._drop(number, error)
                continue
            if data:
                came.append((number, data))
                self._streams[number] = self._streams.pop(number)
        return came

    @property
    def sources(self) -> list[int]:
        """As `Endpoint` has it."""
        return [stream.connection.fileno() for stream in self._streams.values()] + [
            other.fileno() for other in (self._server, self._dialling) if other is not None
        ]

    def close(self) -> None:
        """Close all connections, and what listens or dials."""
        for number in list(self._streams):
            self._streams.pop(number).connection.close()
        for other in (self._server, self._dialling):
            if other is not None:
                other.close()

    def _drop(self, number: int, error: OSError) -> None:
        self._failed(error)
        self._streams.pop(number).connection.close()

    def _welcome(self, now_ns: int) -> None:
        try:
            if self._server is not None:
                for _ in range(ACCEPTS_A_POLL):
                    self._let_in(*self._server.accept())
            elif not self._streams:
                self._dial(now_ns)
        except BlockingIOError:
            return
        except OSError as error:
            self._failed(error)

    def _let_in(self, connection: socket.socket, peer: tuple[str, int]) -> None:
        own = sum(stream.address == peer[0] for stream in self._streams.values())
        if own < CLIENTS_OF_ONE and len(self._streams) < MOST_CLIENTS:
            self._adopt(connection, peer[0])
            return
        connection.close()  # at once: a thousand that wait would hold the descriptors that boxes need
        self._failed(OSError(errno.ENOBUFS, f"{peer[0]} was turned away: {own} of its clients are connected"))

    def _adopt(self, connection: socket.socket, address: str = "") -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._numbers += 1
        self._streams[self._numbers] = _Stream(connection, address)

    def _dial(self, now_ns: int) -> None:
        if self._dialling is None:
            if now_ns < self._redial_ns:
                return
            self._redial_ns = now_ns + REDIAL_NS
            self._dialling = socket.socket(socket.AF_INET6 if ":" in self._address[0] else socket.AF_INET)
            self._dialling.setblocking(False)
        outcome = self._dialling.connect_ex(self._address)
        if outcome in IN_PROGRESS:
            return
        connection, self._dialling = self._dialling, None
        if outcome not in {0, errno.EISCONN}:
            connection.close()
            raise OSError(outcome, os.strerror(outcome))
        self._adopt(connection)


class _Waiting:
    """Whole frames that a line has not taken yet; the oldest go where there is no more room."""

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._begun = b""  # the rest of a frame of which a part is out: cut off it would spoil the next one too
        self._frames: deque[bytes] = deque()

    def put(self, frames: list[bytes]) -> int:
        """Queue frames; how many were dropped for them."""
        self._frames.extend(frames)
        dropped = 0
        while len(self._frames) > 1 and self._bytes() > self._limit_bytes:
            self._frames.popleft()
            dropped += 1
        return dropped

    def next_bytes(self) -> bytes:
        """What is to be written next."""
        return self._begun + b"".join(self._frames)

    def taken(self, count: int) -> None:
        """The line has taken so many bytes of it."""
        left = count - len(self._begun)
        self._begun = self._begun[count:]
        while left > 0:
            frame = self._frames.popleft()
            self._begun, left = frame[left:], left - len(frame)

    def clear(self) -> None:
        """Forget everything: the line is another one."""
        self._begun = b""
        self._frames.clear()

    def _bytes(self) -> int:
        return len(self._begun) + sum(map(len, self._frames))


class SerialEndpoint(Endpoint):
    """A radio or flight controller on a serial line, opened again when it was unplugged."""

    def __init__(self, url: str, device: str, baud: int) -> None:
        super().__init__(url)
        self._device, self._baud = device, baud
        self._line: serial.Serial | None = None
        self._retry_ns = 0
        self._waiting = _Waiting(max(LINE_LEAST_WAITING_BYTES, round(baud / BITS_A_BYTE * LINE_WAITING_S)))

    def send(self, frames: list[bytes], now_ns: int) -> None:
        """As much as the line takes now; what waits longer than its time is dropped, the oldest first."""
        line = self._open(now_ns)
        if line is None or not (frames or self._waiting.next_bytes()):
            return
        dropped = self._waiting.put(frames)
        try:
            # pyserial's own write, told not to wait, turns round and round for as long as the line takes nothing.
            written = os.write(line.fileno(), self._waiting.next_bytes())
            self._waiting.taken(written)
            self.sent_bytes += written
        except BlockingIOError:
            pass
        except (OSError, serial.SerialException) as error:
            self._lost(error)
            return
        if dropped:
            self._failed(
                OSError(errno.ENOBUFS, "the line does not take what is sent: look at its peer, or lower rate_hz")
            )

    def receive(self, now_ns: int) -> list[tuple[int, bytes]]:
        """What came; the peer is always 0."""
        line = self._open(now_ns)
        try:
            data = line.read(LINK_READ_BYTES) if line is not None else b""
        except (OSError, serial.SerialException, TypeError) as error:  # TypeError: pyserial, unplugged while reading
            self._lost(error)
            return []
        return [(0, data)] if data else []

    @property
    def sources(self) -> list[int]:
        """As `Endpoint` has it."""
        return [] if self._line is None else [self._line.fileno()]

    def close(self) -> None:
        """Close the line, without waiting for what it has not taken."""
        if self._line is not None:
            with contextlib.suppress(OSError, termios.error):
                self._line.reset_output_buffer()  # else the kernel waits half a minute for a line that takes nothing
            self._line.close()
            self._line = None
        self._waiting.clear()

    def _open(self, now_ns: int) -> serial.Serial | None:
        if self._line is None and now_ns >= self._retry_ns:
            self._retry_ns = now_ns + REDIAL_NS
            try:
                self._line = serial.Serial(self._device, self._baud, timeout=0, exclusive=True)
                os.set_blocking(self._line.fileno(), False)
            except (OSError, serial.SerialException, ValueError) as error:
                self._lost(error)
        return self._line

    def _lost(self, error: Exception) -> None:
        self._failed(error if isinstance(error, OSError) else OSError(str(error)))
        self.close()


def open_endpoint(url: str) -> Endpoint:
    """The endpoint of a URL, ready to send. Raises ConfigError if it is none, or its name or port cannot be had."""
    kind, _, rest = url.partition(":")
    place, _, number = rest.rpartition(":")
    if remedy := _meant(kind, rest):
        raise ConfigError(f"{url!r} is no MAVLink endpoint", where="mavlink.endpoint.url", action=remedy)
    if not (place and number.isdigit() and kind in {"udp", "tcp", "tcpin", "serial"}):
        raise ConfigError(f"{url!r} is no MAVLink endpoint", where="mavlink.endpoint.url", action=f"write {FORMS}")
    try:
        if kind == "serial":
            return SerialEndpoint(url, place, int(number))
        address = _resolve("::" if place == ":" else place.strip("[]"), int(number))
        return UdpEndpoint(url, address) if kind == "udp" else TcpEndpoint(url, address, listen=kind == "tcpin")
    except (OSError, OverflowError) as error:
        raise ConfigError(
            f"{url!r} cannot be opened ({error})",
            where="mavlink.endpoint.url",
            action="check the host's name, or whether another program holds the port",
        ) from error


def _meant(kind: str, rest: str) -> str:
    """What to write instead of another program's way to write it; empty if it may be ours."""
    if rest.startswith("//"):
        return f"write {kind}:{rest.removeprefix('//')}, without the slashes; or one of {FORMS}"
    if kind in {"udpout", "tcpout"}:
        return f"write {kind.removesuffix('out')}:{rest}; or one of {FORMS}"
    if kind == "udpin":
        return f"this program sends to the receivers: write udp:HOST:PORT with a receiver's address; or one of {FORMS}"
    return ""


def _resolve(host: str, port: int) -> tuple[str, int]:
    """The address of a host. Of a name that has both, IPv4: receivers listen there, and rarely on IPv6 too."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
    address = min(found, key=lambda each: each[0] != socket.AF_INET)[4]
    return str(address[0]), int(address[1])
