"""RTK receivers that are not there: each tripod's antenna position as NMEA, played into a pseudo-terminal.

The programs under test open a serial device and get what a receiver sends: GGA of quality 4, GST and RMC, with
checksums, five times a second, and an error that is correlated over time as that of real RTK is.
"""

import errno
import os
import threading
import time
import tty
from dataclasses import dataclass
from datetime import UTC, datetime
from types import TracebackType
from typing import Final, Self

import numpy as np

from calib.geodesy import Origin, enu_to_geodetic
from edge.common.arrays import Array

PERIOD_S: Final = 0.2  # a usual rate of RTK receivers
SIGMA_M: Final = (0.005, 0.005, 0.010)  # a short baseline to a base station of one's own
TAU_S: Final = 20.0  # correlation time of that error
WHITE_M: Final = 0.001  # noise from epoch to epoch on top of it
UNDULATION_M: Final = 47.6  # geoid above the ellipsoid: the receiver's altitude is above sea level


def sentence(body: str) -> bytes:
    """An NMEA sentence with its checksum."""
    checksum = 0
    for byte in body.encode("ascii"):
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode("ascii")


def epoch(lat_deg: float, lon_deg: float, height_m: float, at: datetime) -> bytes:
    """GGA, GST and RMC of one instant for an ellipsoidal height."""
    clock = at.strftime("%H%M%S.") + f"{at.microsecond // 10000:02d}"
    place = (
        f"{_degrees(lat_deg, 2)},{'N' if lat_deg >= 0 else 'S'},{_degrees(lon_deg, 3)},{'E' if lon_deg >= 0 else 'W'}"
    )
    altitude = f"{height_m - UNDULATION_M:.3f},M,{UNDULATION_M:.3f},M"
    return b"".join(
        [
            sentence(f"GNGGA,{clock},{place},4,24,0.6,{altitude},0.8,0001"),
            sentence(f"GNGST,{clock},0.012,0.006,0.006,0.0,0.006,0.006,0.011"),
            sentence(f"GNRMC,{clock},A,{place},0.00,,{at:%d%m%y},,,R,V"),
        ]
    )


def _degrees(angle_deg: float, digits: int) -> str:
    """Degrees and decimal minutes, to 2 micrometres."""
    # Counted in units of the last decimal, so that 59.99999999 never becomes 60 minutes.
    units = round(abs(angle_deg) * 60 * 10**8)
    degrees, rest = divmod(units, 60 * 10**8)
    minutes, fraction = divmod(rest, 10**8)
    return f"{degrees:0{digits}d}{minutes:02d}.{fraction:08d}"


@dataclass
class _Antenna:
    controller: int
    device: int
    enu: Array
    drift: Array


class Receivers:
    """One receiver a tripod, all in one thread. Use as a context manager; `devices` are the serial ports to open."""

    def __init__(self, antennas_enu: list[Array], origin: Origin, seed: int) -> None:
        self._origin = origin
        self._rng = np.random.default_rng((seed, 200))
        self._antennas = [self._open(np.asarray(enu, float)) for enu in antennas_enu]
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="receivers")

    def _open(self, enu: Array) -> _Antenna:
        controller, device = os.openpty()
        tty.setraw(device)
        os.set_blocking(controller, False)
        return _Antenna(controller, device, enu, self._rng.normal(0.0, SIGMA_M))

    @property
    def devices(self) -> list[str]:
        """Paths of the serial ports."""
        return [os.ttyname(antenna.device) for antenna in self._antennas]

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        for antenna in self._antennas:
            os.close(antenna.controller)
            os.close(antenna.device)

    def _run(self) -> None:
        due_s = time.time() // PERIOD_S * PERIOD_S
        while not self._stop.wait(max(0.0, due_s - time.time())):
            at = datetime.fromtimestamp(round(due_s / PERIOD_S) * PERIOD_S, UTC)
            for antenna in self._antennas:
                self._send(antenna, at)
            due_s += PERIOD_S

    def _send(self, antenna: _Antenna, at: datetime) -> None:
        kept = np.exp(-PERIOD_S / TAU_S)
        antenna.drift = kept * antenna.drift + self._rng.normal(0.0, SIGMA_M) * np.sqrt(1 - kept**2)
        enu = antenna.enu + antenna.drift + self._rng.normal(0.0, WHITE_M, 3)
        lat, lon, height = enu_to_geodetic(enu[None], self._origin)[0].tolist()
        try:
            os.write(antenna.controller, epoch(lat, lon, height, at))
        except OSError as error:
            # Nobody reads yet: a serial line loses what it sends then.
            if error.errno != errno.EAGAIN:
                raise
