"""Where a receiver's bytes come from: a serial device, a TCP stream or a file, behind one small interface.

The hazard is what a vanished device raises. The same unplugged cable gives an OSError, a SerialException, a
termios.error (which is no OSError) or a TypeError, depending on the call it interrupts; and a second program that opens
the device as well steals half of the bytes and gets no error at all. So devices are opened exclusively, by their stable
names, and every one of those exceptions becomes a PortError here, with the reason told apart.
"""

import errno
import termios
from enum import StrEnum
from pathlib import Path
from typing import BinaryIO, Final, Protocol

import serial

from edge.common.errors import GnssError

READ_TIMEOUT_S: Final = 0.1  # how long a read waits for bytes, so that silence is noticed and stopping is quick
READ_BYTES: Final = 4096  # most of one read; 0.1 s of the fastest receiver
STABLE_NAMES: Final = (Path("/dev/serial/by-id"), Path("/dev/serial/by-path"))

_WHAT_DRIVERS_RAISE: Final = (OSError, termios.error, TypeError)  # SerialException is an OSError


class Fault(StrEnum):
    """Why a port gives no bytes."""

    ABSENT = "absent"
    DENIED = "denied"
    BUSY = "busy"
    REFUSED = "refused"
    LOST = "lost"
    ENDED = "ended"


class PortError(GnssError):
    """A port cannot be opened, or was lost while reading; `fault` says which."""

    def __init__(self, what: str, *, where: str, action: str, fault: Fault = Fault.LOST) -> None:
        super().__init__(what, where=where, action=action)
        self.fault = fault


class ReceiverPort(Protocol):
    """An open source of bytes."""

    def read(self) -> bytes:
        """Bytes that have come, b"" if none did within READ_TIMEOUT_S. Raises PortError."""

    def close(self) -> None:
        """Give the port back. Raises nothing."""


def open_port(device: str, baud: int) -> ReceiverPort:
    """Open a serial device, socket://host:port or a file of recorded bytes. Raises PortError with the fault."""
    path = Path(device.removeprefix("file://"))
    try:
        if path.is_file():
            return FilePort(path)
        if "://" in device:
            return SerialPort(serial.serial_for_url(device, baudrate=baud, timeout=READ_TIMEOUT_S))
        return SerialPort(serial.Serial(device, baudrate=baud, timeout=READ_TIMEOUT_S, exclusive=True))
    except (*_WHAT_DRIVERS_RAISE, ValueError) as error:
        raise _explain(error, device) from error


class SerialPort:
    """A serial device or TCP stream, by pyserial."""

    def __init__(self, line: serial.SerialBase) -> None:
        self._line = line

    def read(self) -> bytes:
        """Bytes that have come. Raises PortError when the device is gone."""
        try:
            return bytes(self._line.read(READ_BYTES))
        except _WHAT_DRIVERS_RAISE as error:
            raise PortError(
                f"the device went away ({error})",
                where=str(self._line.port),
                action="plug it in again; it is opened as soon as it is back",
                fault=Fault.LOST,
            ) from error

    def close(self) -> None:
        """Give the device back."""
        try:
            self._line.close()
        except _WHAT_DRIVERS_RAISE:
            return  # a device that is gone needs no closing


class FilePort:
    """A recording, read as fast as it is asked for; its end is a PortError like that of any other port."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO = path.open("rb")

    def read(self) -> bytes:
        """The next bytes of the file. Raises PortError, fault ENDED, at its end."""
        data = self._file.read(READ_BYTES)
        if not data:
            raise PortError("the recording has ended", where=str(self._path), action="nothing to do", fault=Fault.ENDED)
        return data

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def devices() -> list[str]:
    """Stable names of the serial devices present: identical receivers collide in by-id, never in by-path."""
    return sorted(str(link) for folder in STABLE_NAMES if folder.is_dir() for link in folder.iterdir())


def _explain(error: Exception, device: str) -> PortError:
    """The PortError for what a driver raised on opening. pyserial words a lock held by another program its own way."""
    number = getattr(error, "errno", None)
    if "exclusively lock" in str(error) or number in (errno.EBUSY, errno.EAGAIN):
        return PortError(
            "another program has it open",
            where=device,
            action="stop that program (often ModemManager or gpsd), or give this one another device",
            fault=Fault.BUSY,
        )
    if number == errno.EACCES:
        return PortError(
            "no permission to open it",
            where=device,
            action='add this user to the group "dialout" and log in again',
            fault=Fault.DENIED,
        )
    if "://" in device:
        return PortError(
            f"cannot connect ({error})",
            where=device,
            action="check host, port and that the other end is running; it is tried again every second",
            fault=Fault.REFUSED,
        )
    present = ", ".join(devices()) or "none"
    return PortError(
        "no such device" if number == errno.ENOENT else f"cannot be opened ({error})",
        where=device,
        action=f"plug the receiver in; serial devices present: {present}",
        fault=Fault.ABSENT,
    )
