"""The sockets MAVLink goes through: UDP, TCP dialled or listening, a serial line. None ever blocks the loop.

The hazard is a receiver that hangs. pymavlink's own connections swallow errors, look names up while sending, hold one
TCP client and lose the ends of partial writes. Here names are looked up once, every error is counted and the newest
kept for the operator, a client that does not read is dropped, and what is dialled is dialled again.
"""

import errno
import socket
from abc import ABC, abstractmethod
from typing import Final

import serial

from edge.common.errors import ConfigError

LINK_READ_BYTES: Final = 4096
READS_A_POLL: Final = 16  # datagrams: a flood of commands must not hold up targets
BACKLOG_BYTES: Final = 262_144  # per TCP client: seconds of full rate; more means it has stopped reading
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

    @abstractmethod
    def send(self, frames: list[bytes], now_ns: int) -> None:
        """Send whole frames, in order."""

    @abstractmethod
    def receive(self, now_ns: int) -> list[tuple[int, bytes]]:
        """What came: (which peer, bytes)."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the socket or device."""

    def _failed(self, error: OSError) -> None:
        self.errors += 1
        self.last_error = str(error)


class UdpEndpoint(Endpoint):
    """Datagrams to one address; answers come back to the same socket."""

    def __init__(self, url: str, address: tuple[str, int]) -> None:
        super().__init__(url)
        self._address = address
        family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, frames: list[bytes], now_ns: int) -> None:
        for frame in frames:
            try:
                self.sent_bytes += self._socket.sendto(frame, self._address)
            except OSError as error:
                self._failed(error)

    def receive(self, now_ns: int) -> list[tuple[int, bytes]]:
        came: list[tuple[int, bytes]] = []
        for _ in range(READS_A_POLL):
            try:
                came.append((0, self._socket.recv(LINK_READ_BYTES)))
            except BlockingIOError:
                break
            except OSError as error:  # what the network reports of datagrams sent
                self._failed(error)
                break
        return came

    def close(self) -> None:
        self._socket.close()


class _Stream:
    """A connected TCP socket with what it has not yet taken."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
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
    """TCP, dialling a server or serving any number of clients."""

    def __init__(self, url: str, address: tuple[str, int], *, listen: bool) -> None:
        super().__init__(url)
        self._address = address
        self._streams: dict[int, _Stream] = {}
        self._numbers = 0
        self._dialling: socket.socket | None = None
        self._redial_ns = 0
        self._server: socket.socket | None = None
        if listen:
            self._server = socket.create_server(address)
            self._server.setblocking(False)

    def send(self, frames: list[bytes], now_ns: int) -> None:
        self._welcome(now_ns)
        for number, stream in list(self._streams.items()):
            try:
                self.sent_bytes += stream.push(frames)
            except OSError as error:
                self._drop(number, error)

    def receive(self, now_ns: int) -> list[tuple[int, bytes]]:
        self._welcome(now_ns)
        came: list[tuple[int, bytes]] = []
        for number, stream in list(self._streams.items()):
            try:
                came.append((number, stream.pull()))
            except OSError as error:
                self._drop(number, error)
        return [(number, data) for number, data in came if data]

    def close(self) -> None:
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
                self._adopt(self._server.accept()[0])
            elif not self._streams:
                self._dial(now_ns)
        except BlockingIOError:
            return
        except OSError as error:
            self._failed(error)

    def _adopt(self, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._numbers += 1
        self._streams[self._numbers] = _Stream(connection)

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
            raise OSError(outcome, errno.errorcode.get(outcome, "cannot connect"))
        self._adopt(connection)


class SerialEndpoint(Endpoint):
    """A radio or flight controller on a serial line, opened again when it was unplugged."""

    def __init__(self, url: str, device: str, baud: int) -> None:
        super().__init__(url)
        self._device, self._baud = device, baud
        self._line: serial.Serial | None = None
        self._retry_ns = 0

    def send(self, frames: list[bytes], now_ns: int) -> None:
        line = self._open(now_ns)
        if line is None or not frames:
            return
        try:
            data = b"".join(frames)
            written = line.write(data) or 0
            self.sent_bytes += written
            if written < len(data):
                self._failed(OSError(errno.ENOBUFS, "line slower than the stream; lower rate_hz"))
        except (OSError, serial.SerialException) as error:
            self._lost(error)

    def receive(self, now_ns: int) -> list[tuple[int, bytes]]:
        line = self._open(now_ns)
        try:
            data = line.read(LINK_READ_BYTES) if line is not None else b""
        except (OSError, serial.SerialException, TypeError) as error:  # TypeError: pyserial, unplugged while reading
            self._lost(error)
            return []
        return [(0, data)] if data else []

    def close(self) -> None:
        if self._line is not None:
            self._line.close()
            self._line = None

    def _open(self, now_ns: int) -> serial.Serial | None:
        if self._line is None and now_ns >= self._retry_ns:
            self._retry_ns = now_ns + REDIAL_NS
            try:
                self._line = serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)
            except (OSError, serial.SerialException, ValueError) as error:
                self._lost(error)
        return self._line

    def _lost(self, error: Exception) -> None:
        self._failed(OSError(str(error)))
        self.close()


def open_endpoint(url: str) -> Endpoint:
    """The endpoint of a URL, ready to send. Raises ConfigError if it is none, or its name or port cannot be had."""
    kind, _, rest = url.partition(":")
    place, _, number = rest.rpartition(":")
    if not (place and number.isdigit() and kind in {"udp", "tcp", "tcpin", "serial"}):
        raise ConfigError(f"{url!r} is no MAVLink endpoint", where="mavlink.endpoint.url", action=f"write {FORMS}")
    try:
        if kind == "serial":
            return SerialEndpoint(url, place, int(number))
        address = _resolve(place.strip("[]"), int(number))
        return UdpEndpoint(url, address) if kind == "udp" else TcpEndpoint(url, address, listen=kind == "tcpin")
    except (OSError, OverflowError) as error:
        raise ConfigError(
            f"{url!r} cannot be opened ({error})",
            where="mavlink.endpoint.url",
            action="check the host's name, or whether another program holds the port",
        ) from error


def _resolve(host: str, port: int) -> tuple[str, int]:
    found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0][4]
    return str(found[0]), int(found[1])
