"""The tripods' RTK receivers of the demo: GGA of quality 4, GST and RMC five times a second, on serial ports.

The error is correlated over time as that of real RTK is, with a base station of one's own near by.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime
from typing import Final

import numpy as np

from calib.geodesy import Origin, enu_to_geodetic
from edge.common.arrays import Array
from tools.doubles.receiver import Place, gga, gst, rmc
from tools.doubles.serial_receiver import SerialReceiver

PERIOD_S: Final = 0.2  # a usual rate of RTK receivers
SIGMA_M: Final = (0.005, 0.005, 0.010)  # a short baseline to a base station of one's own
TAU_S: Final = 20.0  # correlation time of that error
WHITE_M: Final = 0.001  # noise from epoch to epoch on top of it
UNDULATION_M: Final = 47.6  # geoid above the ellipsoid: the receiver's altitude is above sea level
DECIMALS: Final = 8  # of a minute: 2 micrometres, so that what is off is the error asked for


def epoch(lat_deg: float, lon_deg: float, height_m: float, at: datetime) -> bytes:
    """GGA, GST and RMC of one instant for an ellipsoidal height."""
    place = Place(lat_deg, lon_deg, height_m - UNDULATION_M, UNDULATION_M)
    return gga(at, place, age="0.8", decimals=DECIMALS) + gst(at, SIGMA_M[0]) + rmc(at)


class Antenna:
    """An antenna's position as its receiver finds it, epoch by epoch."""

    def __init__(self, enu: Array, origin: Origin, rng: np.random.Generator) -> None:
        self._enu, self._origin, self._rng = np.asarray(enu, float), origin, rng
        self._drift = rng.normal(0.0, SIGMA_M)

    def say(self, at: datetime) -> bytes:
        """What is sent at an instant."""
        kept = np.exp(-PERIOD_S / TAU_S)
        self._drift = kept * self._drift + self._rng.normal(0.0, SIGMA_M) * np.sqrt(1 - kept**2)
        enu = self._enu + self._drift + self._rng.normal(0.0, WHITE_M, 3)
        lat, lon, height = enu_to_geodetic(enu[None], self._origin)[0].tolist()
        return epoch(lat, lon, height, at)


@contextmanager
def receivers(antennas_enu: list[Array], origin: Origin, seed: int) -> Iterator[list[str]]:
    """One receiver a tripod; the serial ports to open."""
    with ExitStack() as stack:
        antennas = [Antenna(enu, origin, np.random.default_rng((seed, 200, k))) for k, enu in enumerate(antennas_enu)]
        yield [stack.enter_context(SerialReceiver(each.say, period_s=PERIOD_S)).device for each in antennas]
